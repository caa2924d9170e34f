"""Results say which of the user's own code and files they rest on, and go on, or are replayed, with no other."""

from __future__ import annotations

import hashlib
import json
import re
import sys
import types
from pathlib import Path
from typing import Any

import pytest

import aquanav
from aquanav_tools.cli.evaluate import main
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.evaluation import Evaluation
from aquanav_tools.evaluate.own_files import own_files
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.task import TaskOptions
from tests.caves import tube_scenario
from tests.commands import run_here
from tests.own_modules import WriteModule, own_module

__all__ = ["own_module"]

REWARD = """
from {helper} import price
import json
from stable_baselines3 import PPO

class Own:
    base = "careful"

    def terms(self, batch):
        return {{"price": price() * batch.clearances}}

class Height:
    def spec(self, scenario, vehicle):
        return Box(-np.inf, np.inf, (1,))

    def measure(self, batch):
        return batch.positions[:, 2:]

def parts():
    return {{"state": "full", "height": Height()}}

def ahead(observation):
    return [1, 1, 2]
"""
HELPER = "def price():\n    return 0.0\n"
RANGES = "mass = [0.9, 1.1]\n"


def sha256(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


@pytest.fixture
def cave(tmp_path: Path) -> Path:
    write_scenario(tube_scenario(), tmp_path / "tube")
    return tmp_path / "tube"


@pytest.fixture
def modules(own_module: WriteModule) -> tuple[str, str]:
    """Return the names of a module and of the one that it imports."""
    helper = own_module(HELPER)
    own = own_module(REWARD.format(helper=helper))
    Path("own.toml").write_text(RANGES)
    return own, helper


def score(cave: Path, own: str, output: str = "out", **options: Any) -> Evaluation:
    named = {"reward": f"{own}:Own", "sensors": (f"{own}:Height",), "randomisation": "own.toml"}
    given = {"episodes": 3, "max_decisions": 4, "record": "none", "workers": 1, **named, **options}
    return aquanav.evaluate("baseline:random", cave, output=output, **given)


def changed(name: str) -> None:
    """Change a module, as an editor would, and forget that it was imported."""
    path = Path(f"{name}.py")
    path.write_text(path.read_text() + "\n# otherwise\n")
    for loaded in [other for other in sys.modules if other.startswith("own_")]:
        del sys.modules[loaded]


def test_results_have_the_hashes_of_what_is_named_and_of_what_that_imports(
    cave: Path, modules: tuple[str, str]
) -> None:
    own, helper = modules
    table = json.loads(score(cave, own).results.read_text())
    files = {own: sha256(f"{own}.py"), helper: sha256(f"{helper}.py")}
    assert table["own_files"] == {
        f"{own}:Own": files, f"{own}:Height": files, "own.toml": {"own.toml": sha256("own.toml")},
    }  # fmt: skip
    page = Path("out/report.html").read_text()
    assert files[helper] in page and "aquanav-eval replay results.json --episode 0 --trust" in page


def test_a_module_without_a_file_has_no_hash_and_is_evaluated(
    cave: Path, modules: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = types.ModuleType("made_up")
    exec("class Own:\n    def terms(self, batch):\n        return {'none': 0.0 * batch.clearances}\n", made.__dict__)
    monkeypatch.setitem(sys.modules, "made_up", made)
    table = json.loads(score(cave, "made_up", sensors=()).results.read_text())
    assert table["own_files"]["made_up:Own"] == {}


def test_without_code_of_ones_own_there_are_no_hashes(cave: Path) -> None:
    assert own_files(TaskOptions(randomisation="mild"), "full") == {}


@pytest.mark.parametrize("which", [0, 1])
def test_an_evaluation_goes_on_with_the_same_code_only(cave: Path, modules: tuple[str, str], which: int) -> None:
    whole = score(cave, modules[0]).results.read_bytes()
    journal = Path("out/episodes.jsonl")
    journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:2]))
    assert score(cave, modules[0], resume=True).results.read_bytes() == whole
    changed(modules[which])
    named = re.escape(f"own_files ({modules[0]}:Height, {modules[0]}:Own) differ")
    with pytest.raises(InputError, match=f"are of another evaluation: {named}"):
        score(cave, modules[0], resume=True)


def test_an_evaluation_goes_on_with_the_same_ranges_only(cave: Path, modules: tuple[str, str]) -> None:
    score(cave, modules[0])
    Path("own.toml").write_text("mass = [0.8, 1.1]\n")
    with pytest.raises(InputError, match=re.escape("own_files (own.toml) differ")):
        score(cave, modules[0], resume=True)


def test_a_replay_takes_the_same_code_only(cave: Path, modules: tuple[str, str]) -> None:
    own, helper = modules
    score(cave, own)
    assert aquanav.replay("out", 1, trust=True).episode.index == 1
    before = sha256(f"{helper}.py")
    changed(helper)
    now = sha256(f"{helper}.py")
    told = rf"is not what was evaluated \(SHA-256 of {helper}: {now[:12]} instead of {before[:12]}"
    with pytest.raises(InputError, match=told):
        aquanav.replay("out", 1, trust=True)


def test_a_policy_of_ones_own_goes_on_and_is_replayed_with_the_same_code_only(
    cave: Path, modules: tuple[str, str]
) -> None:
    own, helper = modules
    rules = ["--scenario", cave, "--episodes", 3, "--max-decisions", 4, "--record", "none", "--workers", 1, "-o", "out"]
    assert run_here(main, f"{own}:ahead", *rules).returncode == 0
    assert helper in json.loads(Path("out/results.json").read_text())["own_files"][f"{own}:ahead"]
    assert run_here(main, "replay", "out", "--episode", 1, "--trust").returncode == 0
    assert run_here(main, "replay", "out", "--episode", 1, "--policy", f"{own}:ahead").returncode == 0
    changed(helper)
    for words in ([f"{own}:ahead", *rules, "--resume"], ["replay", "out", "--episode", 1, "--trust"]):
        result = run_here(main, *words)
        assert result.returncode == 2 and f"{own}:ahead" in result.stderr


def test_a_policy_that_results_name_is_not_even_imported(cave: Path, own_module: WriteModule) -> None:
    own = own_module("open('imported', 'w')")
    score(cave, "", reward="careful", sensors=(), randomisation=None)
    path = Path("out/results.json")
    table = json.loads(path.read_text())
    for spec in (f"{own}:fly", f"shield:{own}:fly"):
        table["policy"]["path"] = spec
        path.write_text(json.dumps(table))
        with pytest.raises(InputError, match=f"names code: {own}:fly. A file runs none by itself"):
            aquanav.replay("out", 1)
        assert not Path("imported").exists()


def test_code_that_a_recorded_condition_names_is_not_even_imported(cave: Path, own_module: WriteModule) -> None:
    own = own_module("open('imported', 'w')")
    score(cave, "", reward="careful", sensors=(), randomisation=None)
    path = Path("out/results.json")
    table = json.loads(path.read_text())
    table["protocol"]["conditions"][0]["changes"] = {"reward": f"{own}:Own"}
    path.write_text(json.dumps(table))
    with pytest.raises(InputError, match=f"names code: {own}:Own. A file runs none by itself"):
        aquanav.replay("out", 1)
    assert not Path("imported").exists()


def test_a_comparison_says_where_code_was_changed(cave: Path, modules: tuple[str, str]) -> None:
    score(cave, modules[0], "before")
    changed(modules[1])
    score(cave, modules[0], "after")
    notes = aquanav.compare("before", "after").comparisons[0].notes
    assert f"{modules[0]}:Own was changed between the evaluations." in notes


def test_imports_are_followed_through_packages_and_circles_but_not_into_libraries(
    own_module: WriteModule, tmp_path: Path
) -> None:
    name = own_module("")
    folder = tmp_path / f"{name}_package"
    (folder / "inner").mkdir(parents=True)
    files = {
        "__init__.py": "from .first import Own\n",
        "first.py": "from . import second\nimport numpy as np\n\nclass Own:\n    pass\n",
        "second.py": (
            f"def late():\n    from .inner.third import x\n    import {name}_package.first\n"
            "    from . import broken, beyond\n"
        ),
        "inner/__init__.py": "",
        "inner/third.py": "x = 1\n",
        "beside.py": "y = 2\n",
        "broken.py": "def\n",
        "beyond.py": "from .... import nothing\n",
    }
    for file, text in files.items():
        (folder / file).write_text(text)
    found = own_files(TaskOptions(reward=f"{folder.name}:Own"), None)[f"{folder.name}:Own"]
    modules = {"__init__.py": "", "first.py": ".first", "second.py": ".second", "inner/__init__.py": ".inner"}
    modules |= {"inner/third.py": ".inner.third", "broken.py": ".broken", "beyond.py": ".beyond"}
    assert f"{folder.name}.inner.third" not in sys.modules  # found, and not run
    assert found == {folder.name + module: sha256(str(folder / file)) for file, module in modules.items()}


def test_the_search_takes_what_evaluations_take_and_its_worst_cases_fly_again(
    cave: Path, modules: tuple[str, str]
) -> None:
    own, helper = modules
    named = ["--reward", f"{own}:Own", "--observation", f"{own}:parts", "--randomisation", "own.toml"]
    words = ["stress", f"{own}:tall", "--scenario", cave, "--budget", 2, "--max-decisions", 4, "--workers", 1, *named]
    text = Path(f"{own}.py").read_text()
    look = "def tall(observation):\n    assert observation['height'].shape == (1,)\n    return [1, 1, 2]\n"
    Path(f"{own}.py").write_text(text + look)
    result = run_here(main, *words, "-o", "stress")
    assert result.returncode == 0, result.stderr
    table = json.loads(Path("stress/stress.json").read_text())
    assert table["own_files"][f"{own}:parts"] == {own: sha256(f"{own}.py"), helper: sha256(f"{helper}.py")}
    page = Path("stress/report.html").read_text()
    assert f"--observation {own}:parts" in page and "--protocol worst.toml --trust" in page

    again = ["--scenario", cave, "--protocol", "stress/worst.toml", "--trust", "--record", "none", "--workers", 1]
    result = run_here(main, f"{own}:tall", *again, "-o", "again")
    assert result.returncode == 0, result.stderr
    episodes = json.loads(Path("again/results.json").read_text())["episodes"]
    assert [one["digest"] for one in episodes] == [one["digest"] for one in table["worst"]]
    drawn = [round(one["dynamics"]["mass"], 6) for one in table["worst"]]
    assert [one["dynamics"]["mass"] for one in episodes] == drawn

    changed(helper)
    result = run_here(main, *words, "-o", "stress", "--resume")
    assert result.returncode == 2 and "own_files (" in result.stderr


def test_the_search_takes_another_vehicle(cave: Path, modules: tuple[str, str]) -> None:
    words = ["stress", "baseline:random", "--scenario", cave, "--budget", 1, "--max-decisions", 3, "--workers", 1]
    result = run_here(main, *words, "--vehicle", "bluerov2-heavy", "-o", "stress")
    assert result.returncode == 0, result.stderr
    assert json.loads(Path("stress/stress.json").read_text())["vehicle"]["name"] == "bluerov2-heavy"
    result = run_here(main, *words, "-o", "stress", "--resume")
    assert result.returncode == 2 and "vehicle" in result.stderr
