"""A package ``law`` with two kernels that compile in no time, one of which calls the other."""

FILES = {
    "__init__.py": (
        "from pathlib import Path\n"
        "from sffr_gym.compile.cache import cache_sources\n"
        "cache_sources(__name__, Path(__file__).parent.rglob('*.py'))\n"
    ),
    "gain.py": "from sffr_gym.compile.kernels import kernel\n\n@kernel\ndef gain(x):\n    return 2 * x\n",
    "loop.py": (
        "from sffr_gym.compile.kernels import kernel\nfrom law.gain import gain\n\n"
        "@kernel\ndef loop(x):\n    return gain(x) + 1\n"
    ),
}


def write(folder):
    """Write the package into a folder, and return the folder."""
    (folder / "law").mkdir()
    for name, text in FILES.items():
        (folder / "law" / name).write_text(text)
    return folder
