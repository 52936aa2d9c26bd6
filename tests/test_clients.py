"""The runner of clients: it finds each page's programs, tells failures, and keeps the rows of others."""

import runpy
import subprocess
import sys
import types
from pathlib import Path

import gymnasium as gym
import optuna
import pytest
import yaml
from project import ROOT

from sffr_agents.config import load_config

sys.path.insert(0, str(Path(__file__).parent / "clients"))
import cleanrl_script
import run

PAGE = (ROOT / "docs" / "clients" / "cleanrl.md").read_text(encoding="utf-8")
SCRIPT = """
    envs = gym.vector.SyncVectorEnv(
        [make_env(args.env_id, i) for i in range(args.num_envs)]
    )
    assert isinstance(envs.single_action_space, gym.spaces.Box)
            next_obs, reward, terminations, truncations, infos = envs.step(action.cpu().numpy())

            if "final_info" in infos:
                for info in infos["final_info"]:
                    print(f"episodic_return={info['episode']['r']}")

        # bootstrap value if not done
"""


@pytest.mark.parametrize("name", run.CLIENTS)
def test_a_client_has_a_page_with_programs(name):
    text = (run.PAGES / f"{name}.md").read_text(encoding="utf-8")
    assert run.BLOCK.findall(text)
    assert f"\n{name}\n" in (run.PAGES / "index.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("algo", "same"),
    [
        ("ppo", {"n_epochs", "gamma", "gae_lambda", "clip_range", "ent_coef"}),
        ("sac", {"learning_starts", "batch_size", "buffer_size", "gamma", "tau", "train_freq", "gradient_steps"}),
    ],
)
def test_the_zoos_hyperparameters_are_those_of_the_shipped_training(algo, same):
    """As its files say, but for what only sffr train has and what the number of environments changes."""
    zoo = yaml.safe_load((ROOT / "configs" / "zoo" / f"{algo}.yml").read_text(encoding="utf-8"))["SFFRFlexDamping-v0"]
    own = load_config(algo).learning
    assert {name: zoo[name] for name in same} == {name: getattr(own, name) for name in same}
    assert float(zoo["learning_rate"].removeprefix("lin_")) == own.learning_rate
    assert zoo["normalize"] == {"norm_obs": False, "norm_reward": True}, "returns of 2,000 and more; `sffr export`"


@pytest.mark.parametrize("env", ["SFFRFlexDamping-v0", "SFFRFlex-v0"])
def test_the_zoos_search_begins_at_the_files_settings(env, monkeypatch):
    """Where the zoo is not installed, two of its names stand for it."""
    samplers = {}
    for name, content in (
        ("rl_zoo3", {}),
        ("rl_zoo3.hyperparams_opt", {"HYPERPARAMS_SAMPLER": samplers}),
        ("rl_zoo3.utils", {"SimpleLinearSchedule": float}),
    ):
        module = types.ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    search = runpy.run_path(str(ROOT / "configs" / "zoo" / "search.py"))
    own = search["FILE"][env]
    trial = optuna.trial.FixedTrial(search["start"](own), number=1)
    (actions,) = (number for number, name in search["ID"].items() if name == env)
    assert gym.make(f"sffr_gym:{env}").action_space.shape == (actions,)
    drawn = samplers["ppo"](trial, actions, own["n_envs"], {})
    assert drawn.pop("learning_rate") == float(own["learning_rate"].removeprefix("lin_"))
    kwargs = drawn.pop("policy_kwargs")
    assert kwargs["net_arch"] == own["policy_kwargs"]["net_arch"]
    assert kwargs["log_std_init"] == pytest.approx(own["policy_kwargs"]["log_std_init"])
    assert drawn == pytest.approx({name: own[name] for name in drawn})


def test_the_table_is_of_known_clients_and_nothing_failed():
    """It is written by `make clients` alone."""
    lines = run.TABLE.read_text(encoding="utf-8").splitlines()
    assert lines[0] == f"| {' | '.join(run.HEAD)} |"
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]
    assert {row[0] for row in cells} <= {f"[{client.name}]({name}.md)" for name, client in run.CLIENTS.items()}
    assert all(row[4] == "works" and row[1][0].isdigit() for row in cells)


def test_rows_of_other_clients_stay(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "TABLE", tmp_path / "tried.md")
    monkeypatch.setattr(run, "version_of", lambda name, package: "1.0")
    for name, state in (("skrl", "works"), ("sb3", "works"), ("skrl", "fails: a | b")):
        run.write_row(name, state)
    lines = run.TABLE.read_text().splitlines()
    assert [line.split("](")[0] for line in lines[2:]] == ["| [Stable-Baselines3", "| [skrl"]
    assert "fails: a \\| b" in lines[3] and "works" in lines[2]


def test_what_fails_is_told_in_a_line(tmp_path, monkeypatch):
    """The last line of a program's output, and the count of failures."""
    (tmp_path / "skrl.md").write_text("```python\nraise SystemExit('no such thing')\n```\n")
    monkeypatch.setattr(run, "PAGES", tmp_path)
    monkeypatch.setattr(run, "prepare", lambda client, folder: None)
    monkeypatch.setattr(run, "SCRATCH", tmp_path)
    (tmp_path / "skrl" / "bin").mkdir(parents=True)
    (tmp_path / "skrl" / "bin" / "python").symlink_to(sys.executable)
    assert run.run("skrl") == "fails: no such thing"
    (tmp_path / "skrl.md").write_text("```python\nprint(3)\n```\n```bash\nfalse\n```\n")
    assert run.run("skrl").startswith("fails: ")
    (tmp_path / "skrl.md").write_text("```python\nprint(3)\n```\n```bash\ntrue\n```\n```\nno program\n```\n")
    assert run.run("skrl") == "works"


def test_an_unknown_client_is_refused():
    done = subprocess.run([sys.executable, run.__file__, "cleanlr"], capture_output=True, text=True)
    assert done.returncode == 1 and "unknown client 'cleanlr'" in done.stderr


def test_the_two_changes_of_cleanrls_script_are_the_pages():
    """Its own lines go, the page's come, in both forms that its releases have."""
    older = SCRIPT.replace(
        'if "final_info" in infos:\n',
        "# Only print when at least 1 env is done\n"
        '            if "final_info" not in infos:\n                continue\n\n',
    )
    for script in (SCRIPT, older):
        text = cleanrl_script.changed(script, PAGE)
        assert "SyncVectorEnv" not in text and 'autoreset_mode="SameStep"' in text
        assert "for info in infos" not in text and "for i in np.flatnonzero(ended)" in text
    with pytest.raises(AssertionError, match="another one than the page tells of"):
        cleanrl_script.changed("pass", PAGE)
