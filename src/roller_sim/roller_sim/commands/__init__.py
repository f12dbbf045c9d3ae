"""Subcommands of roller: simulate."""
