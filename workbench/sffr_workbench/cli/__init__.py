"""The command line ``sffr``: a module for each command or family of commands, put together in ``app``."""
