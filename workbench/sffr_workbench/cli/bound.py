"""``sffr bound``: arguments, and what the terminal shows."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sffr_agents.bound import BoundSettings, find_bound
from sffr_agents.config import VALIDATION_SEED
from sffr_baselines.learned import load_schedule, save_schedule
from sffr_baselines.scheduled import RHO, SCHEDULED
from sffr_gym import ConfigError
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.files import check_target
from sffr_workbench.cli.options import Overwrite, Quiet, argument, option, whole
from sffr_workbench.cli.progress import ProgressBar, time_left
from sffr_workbench.cli.terminal import consoles, interruptible, user_errors
from sffr_workbench.common import require
from sffr_workbench.common.numbers import format_number

DEFAULTS = BoundSettings()


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("bound", no_args_is_help=True)(bound_command)


def bound_command(
    scenarios: Annotated[list[str], argument("SCENARIO...", "Whose mean cost counts: shipped names or YAML files.")],
    out: Annotated[Path, option("--out -o", "Where the policy goes.", "FILE")] = Path("bound.npz"),
    law: Annotated[str, option("--law", f"Law inside: {', '.join(SCHEDULED)}.", "LAW")] = "ahsc",
    rho: Annotated[float, option("--rho", "Largest factor of its damping.", "R")] = RHO,
    base_tolerance: Annotated[
        float | None,
        option("--base-tolerance", "Error of the base at which an action counts half, in m.", "M", "always in full"),
    ] = None,
    stack_size: Annotated[
        int, option("--stack-size", "Observations of a panel that are seen at once: a memory.", "N", parser=whole())
    ] = DEFAULTS.stack_size,
    feature: Annotated[
        list[str] | None,
        option("--feature", "Only these count of what is seen of a panel; repeatable.", "NAME", "all"),
    ] = None,
    hidden: Annotated[
        int, option("--hidden", "Rectified units between what is seen and the actions.", "N", parser=whole(0))
    ] = DEFAULTS.hidden,
    episodes: Annotated[
        int, option("--episodes -n", f"Of each scenario that draws, from seed {VALIDATION_SEED}.", "N", parser=whole())
    ] = DEFAULTS.episodes,
    generations: Annotated[int, option("--generations", "Of the search.", "N", parser=whole())] = DEFAULTS.generations,
    spread: Annotated[
        float, option("--spread", "Of the first candidates' weights: less where the law is near the best.", "S")
    ] = DEFAULTS.spread,
    effort_price: Annotated[
        float, option("--effort-price", "Of the piezos' effort, over its price in the score.", "K")
    ] = DEFAULTS.effort_price,
    start: Annotated[
        Path | None, option("--start", "Begin from a policy that this command has found.", "FILE", "the law itself")
    ] = None,
    seed: Annotated[int, option("--seed", "Of the search.", "K", parser=whole(0))] = 0,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    r"""Search the best schedule of a law's damping for some episodes: a bound for what learning can reach there.

    CMA-ES on whole episodes, with the score as its aim. Leaves the best so far after every generation, as a policy
    for sffr evaluate and sffr benchmark. Needs the extra [bold]tune[/]: pip install "sffr-gym\[tune]".
    """
    notes, results = consoles(quiet)
    with user_errors():
        if out.suffix != ".npz":
            raise ConfigError(f"{out}: a policy's file ends in .npz")
        check_target(out, overwrite)
        settings = check_arguments(
            BoundSettings, scenarios=tuple(scenarios), law=law, rho=rho, base_tolerance=base_tolerance,
            stack_size=stack_size,
            features=DEFAULTS.features if feature is None else tuple(feature), hidden=hidden, episodes=episodes,
            generations=generations, spread=spread, effort_price=effort_price, seed=seed,
        )  # fmt: skip
        begin = None if start is None else load_schedule(start)
        require("tune", "cma")
        advice = f"{out} holds the best so far"
        with interruptible(notes, advice), ProgressBar(notes, *time_left()) as bar:
            cost = float("nan")
            for generation, (schedule, cost) in enumerate(find_bound(settings, begin), start=1):
                save_schedule(out, schedule)
                bar(f"cost {format_number(cost)}", generation, settings.generations)
    results.print(f"{out}: cost {format_number(cost)} where it was searched", markup=False, soft_wrap=True)
