"""Teaching demos: one idea each, rendered by the engine and compared with theory."""
