"""The subcommands of `roller`, one module each."""
