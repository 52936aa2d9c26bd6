"""The table of the mutation tests fits the sources: no module, test or accepted line in it is gone."""

import shlex
from pathlib import Path

import pytest

mutants = pytest.importorskip("cosmic_ray") and __import__("mutants")
ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("module", mutants.MODULES)
def test_modules_have_mutants_and_tests(module):
    tests = [word for test in mutants.MODULES[module] for word in shlex.split(test) if word.endswith(".py")]
    assert tests and all((ROOT / "tests" / test).is_file() for test in tests)
    found = mutants.mutants_of(module)
    assert len({mutant.key for mutant in found}) == len(found)
    assert mutants.sample(found, 3) == mutants.sample(found, 3)
    source = (ROOT / module).read_text(encoding="utf-8")
    for mutant in mutants.sample(found, 3):
        changed = mutant.source()
        assert changed != source
        compile(changed, module, "exec")


@pytest.mark.parametrize("entry", mutants.CONFIG.get("accepted", ()), ids=lambda entry: entry["line"])
def test_accepted_lines_are_still_there(entry):
    assert any(mutants.matches(entry, mutant) for mutant in mutants.mutants_of(entry["module"]))
    assert entry["reason"]
