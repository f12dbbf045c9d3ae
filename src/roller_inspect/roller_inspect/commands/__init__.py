"""Subcommands of roller: replay."""
