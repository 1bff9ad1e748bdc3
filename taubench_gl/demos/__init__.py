"""Teaching demos: numbered, one idea each, drawn by the engine itself and checked against what theory says."""
