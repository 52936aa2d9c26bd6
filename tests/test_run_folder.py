"""Files of a run folder: written whole or not at all, readable by others, and signed by the checkout."""

import json
import math
import shutil
import subprocess

import pytest

from sffr_gym.config.files import to_json, write_whole
from sffr_gym.config.provenance import git_state


def test_file_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    file = write_whole(tmp_path / "a.json", b"old")

    def full(self, content):
        with self.open("wb") as part:
            part.write(content[:1])
        raise OSError("no space left")

    monkeypatch.setattr(type(file), "write_bytes", full)
    with pytest.raises(OSError, match="no space"):
        write_whole(file, b"new")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_json_has_null_for_what_is_not_a_number():
    assert json.loads(to_json({"a": [math.nan, math.inf, 1.5], "b": None})) == {"a": [None, None, 1.5], "b": None}


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_git_state_is_that_of_the_checkout_that_tracks_the_sources(tmp_path):
    def git(*arguments):
        identity = ["-c", "user.name=a", "-c", "user.email=a@b"]
        subprocess.run(["git", "-C", str(tmp_path), *identity, *arguments], check=True, capture_output=True)

    source, other = tmp_path / "package", tmp_path / "ignored" / "package"
    for folder in source, other:
        folder.mkdir(parents=True)
        (folder / "__init__.py").write_text("")
    assert git_state(source) is None
    git("init")
    (tmp_path / ".gitignore").write_text("ignored/\n")
    git("add", ".")
    git("commit", "-m", "first")
    state = git_state(source)
    assert len(state["commit"]) == 40 and state["dirty"] is False
    assert git_state(other) is None  # an environment that happens to lie in a checkout
    (source / "__init__.py").write_text("changed = True\n")
    assert git_state(source)["dirty"] is True
