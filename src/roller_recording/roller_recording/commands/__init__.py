"""Subcommands of roller: record and info."""
