"""Subcommands of `roller`."""
