"""``python -m sffr_gym``: the command ``sffr``, for who has no folder of commands on the path."""

from importlib import import_module

if __name__ == "__main__":
    import_module("sffr_workbench.cli.main").main()
