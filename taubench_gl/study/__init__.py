"""The study engine: units of work, engines that run them, a store of their records, one driver (docs/batch.md)."""
