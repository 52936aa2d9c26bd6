"""The table of the mutation tests fits the sources: no module, test or accepted line in it is gone."""

import functools
import re
import shlex
import subprocess
import sys

import pytest
from project import ROOT

mutants = pytest.importorskip("cosmic_ray") and __import__("mutants")
mutants_of = functools.cache(mutants.mutants_of)  # of a module, which many accepted lines are of


def collected(request, files):
    """Lines ``FILE::TEST`` of the fast tests: of this run if it has all the files, else asked of another pytest."""
    here = [item.nodeid for item in request.session.items if item.get_closest_marker("slow") is None]
    if {f"{file}::" for file in files} <= {name[: name.index("::") + 2] for name in here} and not narrowed(request):
        return here
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-m", "not slow", *files]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()


def narrowed(request):
    """Whether this run leaves out fast tests of its files."""
    return bool(request.config.option.keyword) or request.config.option.markexpr not in ("", "not slow")


@pytest.fixture(scope="module")
def fast_tests(request):
    """Names of the fast tests of each file, with their parameters."""
    files = sorted({f"tests/{shlex.split(test)[0]}" for tests in mutants.MODULES.values() for test in tests})
    lines = [line for line in collected(request, files) if line.startswith("tests/") and "::" in line]
    names = [line.removeprefix("tests/").split("::", 1) for line in lines]
    return {file: [name.lower() for other, name in names if other == file] for file, _ in names}


@pytest.mark.parametrize("module", mutants.MODULES)
def test_chosen_tests_are_there(module, fast_tests):
    """Each word that chooses tests by name finds one: a test of another name would leave mutants alive."""
    for test in mutants.MODULES[module]:
        file, *option = shlex.split(test)
        words = re.findall(r"[\w.]+", option[1]) if option else ["test"]
        for word in {*words} - {"or", "and", "not"}:
            assert any(word.lower() in name for name in fast_tests[file]), f"{file}: no test is called {word}"


@pytest.mark.parametrize("module", mutants.MODULES)
def test_modules_have_mutants_and_tests(module):
    tests = [word for test in mutants.MODULES[module] for word in shlex.split(test) if word.endswith(".py")]
    assert tests and all((ROOT / "tests" / test).is_file() for test in tests)
    found = mutants_of(module)
    assert len({mutant.key for mutant in found}) == len(found)
    assert mutants.sample(found, 3) == mutants.sample(found, 3)
    assert any(mutants.sample(found, 3, draw) != mutants.sample(found, 3) for draw in range(1, 9)) or len(found) <= 3
    source = (ROOT / module).read_text(encoding="utf-8")
    for mutant in mutants.sample(found, 3):
        changed = mutant.source()
        assert changed != source
        compile(changed, module, "exec")


def test_report_counts_by_package_and_names_survivors():
    """Of two modules with a survivor each, one of them with a reason, and one that was not tested."""
    task, _, other = (mutants_of(name) for name in list(mutants.MODULES)[:3])
    accepted = next(mutant for mutant in mutants_of("sffr_gym/task/control_period.py") if mutant.reason)
    page = mutants.report([
        mutants.Tested(task[0].module, len(task), 6, [task[0]]),
        mutants.Tested("baselines/sffr_baselines/x.py", 9, 4, [accepted]),
        mutants.Tested(other[0].module, len(other), 0, []),
    ])  # fmt: skip
    assert "8 of 10 tested mutants are caught, 80.0 %; of those without an accepted reason 8 of 9, 88.9 %." in page
    assert f"Not tested: `{other[0].module}`." in page and "only samples are tested" in page
    assert (
        f"| `sffr_gym` | {len(task)} | 6 | 5 | 0 | 1 |" in page and "| `sffr_baselines` | 9 | 4 | 3 | 1 | 0 |" in page
    )
    assert f"| all | {len(task) + 9} | 10 | 8 | 1 | 1 |" in page
    assert task[0].changed in page and "**none**" in page and accepted.reason in page
    assert "Only a sample" not in mutants.report([mutants.Tested("sffr_gym/x.py", 2, 2, [])])


@pytest.mark.parametrize("kind", [str, list])
def test_an_accepted_change_is_not_another_change_of_its_line(kind):
    """Unless the entry says nothing of what the line is changed to."""
    entry = next(each for each in mutants.CONFIG["accepted"] if isinstance(each.get("changed"), kind))
    whole = {name: value for name, value in entry.items() if name != "changed"}
    found = [mutant for mutant in mutants_of(entry["module"]) if mutants.matches(whole, mutant)]
    accepted = [mutant.changed for mutant in found if mutants.matches(entry, mutant)]
    assert sorted(accepted) == sorted([entry["changed"]] if kind is str else entry["changed"])
    assert len(found) > len(accepted)


@pytest.mark.parametrize("entry", mutants.CONFIG.get("accepted", ()), ids=lambda entry: entry["line"])
def test_accepted_lines_are_still_there(entry):
    found = {mutant.changed for mutant in mutants_of(entry["module"]) if mutants.matches(entry, mutant)}
    changed = entry.get("changed", found)
    assert found == ({changed} if isinstance(changed, str) else set(changed)) and found
    assert entry["reason"]
