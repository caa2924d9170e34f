"""With PyBullet and without it: who solves contacts, and whether environment, results and errors say so."""

from __future__ import annotations

import functools
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.cli import train as train_command
from aquanav_tools.cli.evaluate import main as evaluate_command
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.envs.vector_env import CaveVectorEnv
from aquanav_tools.errors import ResourceError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.contacts import contacts_of, default_backend, default_contacts
from tests.bullet import needs_bullet
from tests.caves import write_short
from tests.commands import run_here

aquanav_eval = functools.partial(run_here, evaluate_command)
MISSING = "the library pybullet, which is not installed. Install it: pip install 'aquanav[bullet]'"


@pytest.fixture
def without_bullet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Importing PyBullet fails as where it is not installed."""
    monkeypatch.setitem(sys.modules, "pybullet", None)
    monkeypatch.delitem(sys.modules, "aquanav_tools.sim.bullet", raising=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, tube: Scenario) -> Path:
    return write_short(tube, tmp_path_factory.mktemp("scenario") / "tube", 60)


def scraped(tube: Scenario, contacts: str | None) -> np.ndarray:
    """Return where a vehicle was while it scraped along the wall."""
    env = CaveEnv(tube, contacts=contacts, action="continuous")  # type: ignore[arg-type]
    _, info = env.reset(seed=0)
    places = []
    for _ in range(120):
        *_, info = env.step(np.array([1.0, 0.3, 1.0], dtype=np.float32))  # up, against the roof
        places.append(info["position"])
    env.close()
    assert info["num_collisions"] > 0, "it touched nothing, so that nothing is tested"
    return np.array(places)


def test_without_pybullet_the_default_is_our_own_contacts(without_bullet: None, tube: Scenario) -> None:
    assert (default_contacts(), default_backend()) == ("own", "own")
    env = CaveEnv(tube)
    assert env.metadata["contacts"] == "own"
    env.close()
    np.testing.assert_array_equal(scraped(tube, None), scraped(tube, "own"))


@needs_bullet
def test_with_pybullet_the_default_is_pybullets_contacts(tube: Scenario) -> None:
    assert (default_contacts(), default_backend()) == ("bullet", "pybullet")
    env = CaveEnv(tube)
    assert env.metadata["contacts"] == "bullet"
    env.close()
    default = scraped(tube, None)
    np.testing.assert_array_equal(default, scraped(tube, "bullet"))
    assert not np.array_equal(default, scraped(tube, "own"))


def test_every_environment_says_who_solves_contacts(tube: Scenario) -> None:
    batch, alone = CaveVectorEnv(2, tube), CaveEnv(tube, contacts="own")
    assert batch.metadata["contacts"] == alone.metadata["contacts"] == SurfaceEnv.metadata["contacts"] == "own"
    assert CaveEnv.metadata["render_modes"] == alone.metadata["render_modes"]
    batch.close()
    alone.close()


def test_each_backend_has_its_contacts() -> None:
    assert [contacts_of(name) for name in ("pybullet", "own", "batch")] == ["bullet", "own", "own"]


@pytest.mark.parametrize("make", [CaveEnv, functools.partial(CaveVectorEnv, 2)])
def test_pybullet_asked_for_and_missing_gets_the_extra_that_brings_it(
    without_bullet: None, tube: Scenario, make: type[CaveEnv]
) -> None:
    with pytest.raises(ResourceError, match="contacts='own', --backend own") as raised:
        make(tube, contacts="bullet")
    assert MISSING in str(raised.value) and "20 minutes, with a C++ compiler" in str(raised.value)


def test_half_an_installation_of_pybullet_says_why_it_does_not_load(
    tube: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pybullet.py").write_text("raise ImportError('libfoo.so.1: cannot open shared object file')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pybullet", raising=False)
    monkeypatch.delitem(sys.modules, "aquanav_tools.sim.bullet", raising=False)
    assert default_contacts() == "bullet", "what is installed is not passed over in silence"
    with pytest.raises(ResourceError, match=r"does not load: ImportError: libfoo.so.1.*--force-reinstall pybullet"):
        CaveEnv(tube)


def test_gymnasiums_name_leads_to_an_environment_in_a_process_without_pybullet(folder: Path) -> None:
    code = f"""import sys; sys.modules["pybullet"] = None
import gymnasium, aquanav_tools.envs
env = gymnasium.make("aquanav/Cave-v0", scenario={str(folder)!r})
env.reset(seed=0); env.step(env.action_space.sample())
print(env.metadata["contacts"], env.unwrapped.metadata["contacts"])"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "own own\n"


def test_results_and_report_name_the_backend(without_bullet: None, folder: Path, tmp_path: Path) -> None:
    words = ("baseline:reactive", "--scenario", folder, "--episodes", 2, "--workers", 1, "--record", "none")
    done = aquanav_eval(*words, "-o", tmp_path)
    assert done.returncode == 0, done.stderr
    table = json.loads((tmp_path / "results.json").read_text())
    assert table["protocol"]["backend"] == "own"
    assert "--backend own" in (tmp_path / "report.html").read_text()


def test_a_replay_takes_the_backend_of_the_results(without_bullet: None, folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="replays are recorded, which needs rerun")
    words = ("baseline:reactive", "--scenario", folder, "--episodes", 2, "--workers", 1, "--record", "none")
    assert aquanav_eval(*words, "-o", tmp_path).returncode == 0
    table = json.loads((tmp_path / "results.json").read_text())
    assert aquanav_eval("replay", tmp_path, "--episode", 1).returncode == 0
    table["protocol"]["backend"] = "pybullet"
    (tmp_path / "results.json").write_text(json.dumps(table))
    refused = aquanav_eval("replay", tmp_path, "--episode", 1)
    assert refused.returncode == ResourceError.exit_code and MISSING in " ".join(refused.stderr.split())


def test_evaluation_refuses_a_missing_pybullet_before_it_writes_anything(
    without_bullet: None, folder: Path, tmp_path: Path
) -> None:
    done = aquanav_eval("baseline:random", "--scenario", folder, "--backend", "pybullet", "-o", tmp_path / "eval")
    assert done.returncode == ResourceError.exit_code and MISSING in " ".join(done.stderr.split())
    assert not (tmp_path / "eval").exists()


def test_training_refuses_a_missing_pybullet_before_it_writes_anything(
    without_bullet: None, folder: Path, tmp_path: Path
) -> None:
    pytest.importorskip("torch", reason="training needs torch")
    words = ("--scenario", folder, "--steps", 64, "--backend", "pybullet", "-o", tmp_path / "train")
    done = run_here(train_command.main, *words)
    assert done.returncode == ResourceError.exit_code and MISSING in " ".join(done.stderr.split())
    assert not (tmp_path / "train").exists()
