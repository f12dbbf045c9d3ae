"""Subcommands of roller: bench and evaluate."""
