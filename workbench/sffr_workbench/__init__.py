"""The workbench: the command line and what it makes."""
