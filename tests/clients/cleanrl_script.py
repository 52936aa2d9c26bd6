"""Runs CleanRL's own ``ppo_continuous_action.py`` with the two changes that its page tells, and demands its returns."""

from __future__ import annotations

import importlib.util
import re
import runpy
import sys
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "clients" / "cleanrl.md"


def changed(script: str, page: str) -> str:
    """Return the script with the page's lines in place of those that make ``envs`` and those that log episodes."""
    first, second = re.findall(r"^```python\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)[:2]
    loop = second[second.index("    ended = ") :]  # from the loop of the page
    indent = "            "
    logged = "".join(f"{indent}{line[4:]}\n" for line in loop.splitlines() if line.strip())
    script, made = re.subn(
        r"    envs = gym\.vector\.SyncVectorEnv\(\n.*?\n    \)\n",
        lambda _: "".join(f"    {line}\n" for line in first.splitlines()), script, count=1, flags=re.DOTALL,
    )  # fmt: skip
    script, told = re.subn(
        r"            (# Only print when at least 1 env is done\n            if \"final_info\" not in infos:\n.*?"
        r"|if \"final_info\" in infos:\n.*?)(?=        # bootstrap value)",
        lambda _: f"{logged}\n", script, count=1, flags=re.DOTALL,
    )  # fmt: skip
    assert (made, told) == (1, 1), "the script is another one than the page tells of"
    return script


def main() -> None:
    """Run it for 600 steps of each of 8 environments, two episodes."""
    found = importlib.util.find_spec("cleanrl")
    assert found is not None and found.submodule_search_locations
    source = Path(found.submodule_search_locations[0], "ppo_continuous_action.py").read_text(encoding="utf-8")
    program = Path("cleanrl_changed.py")
    program.write_text(changed(source, PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    sys.argv = [str(program), "--total-timesteps", "4800", "--num-steps", "300", "--num-envs", "8"]
    told: list[str] = []
    write = sys.stdout.write
    sys.stdout.write = lambda text: (told.append(text), write(text))[1]  # type: ignore[assignment, func-returns-value]
    runpy.run_path(str(program), run_name="__main__")
    returns = [float(each) for each in re.findall(r"episodic_return=(-?[\d.]+)", "".join(told))]
    assert len(returns) == 16, f"16 episodes ended, {len(returns)} were told"
    assert all(each < 0.0 for each in returns)


if __name__ == "__main__":
    main()
