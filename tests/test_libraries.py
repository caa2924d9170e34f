"""Who lacks a library, or has half of one, reads one sentence: what needs it, which extra brings it, what fails."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import aquanav
from aquanav_tools.cli import build_cave as build_cave_command
from aquanav_tools.cli import evaluate as eval_command
from aquanav_tools.cli import info
from aquanav_tools.cli import train as train_command
from aquanav_tools.errors import LibraryError
from aquanav_tools.evaluate import policies
from aquanav_tools.libraries import LEARNING, OPTIONAL, explained_imports, is_installed, lack_of, require
from aquanav_tools.scenario.folder import write_scenario
from tests.caves import tube_scenario
from tests.commands import run_here
from tests.conftest import REPOSITORY
from tests.project import pyproject

REFERENCE_ZIP = REPOSITORY / "eval" / "policies" / "reference.zip"
BLOCKER = """
import importlib.abc


class Blocker(importlib.abc.MetaPathFinder):
    def __init__(self, *modules):
        self.modules = modules

    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in self.modules:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
"""
"""Takes libraries away from an interpreter when it is put first in sys.meta_path."""


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Take libraries away from this process."""
    found: dict[str, Any] = {}
    exec(BLOCKER, found)

    def take(*modules: str) -> None:
        for name in [name for name in sys.modules if name.split(".")[0] in modules]:
            monkeypatch.delitem(sys.modules, name)
        monkeypatch.setattr(sys, "meta_path", [found["Blocker"](*modules), *sys.meta_path])

    return take


@pytest.fixture
def half_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[str, str | None], None]:
    """Put a package that runs some code when it is imported, or a folder without any, in a library's place."""

    def put(module: str, code: str | None) -> None:
        folder = tmp_path / "site" / module
        folder.mkdir(parents=True)
        if code is not None:
            (folder / "__init__.py").write_text(code)
        monkeypatch.syspath_prepend(str(folder.parent))
        for name in [name for name in sys.modules if name.split(".")[0] == module]:
            monkeypatch.delitem(sys.modules, name)

    return put


@pytest.fixture
def tube_folder(tmp_path: Path) -> Path:
    write_scenario(tube_scenario(), tmp_path / "tube")
    return tmp_path / "tube"


def sentence(extra: str, package: str) -> str:
    """The part of a message that is the same everywhere, as a pattern."""
    return rf"needs the library {package}, which is not installed\. Install it: pip install 'aquanav\[{extra}\]'"


def test_the_extras_bring_the_libraries_that_the_table_says() -> None:
    extras = pyproject()["project"]["optional-dependencies"]
    packages = {
        extra: {canonicalize_name(need.name) for text in texts for need in [Requirement(text)]}
        | ({"lazrs"} if any("[lazrs]" in text for text in texts) else set())
        for extra, texts in extras.items()
    }
    lacking = {
        module: library
        for module, library in OPTIONAL.items()
        if library.extra != "bullet" and canonicalize_name(library.package) not in packages[library.extra]
    }
    assert lacking == {}
    core = {canonicalize_name(Requirement(text).name) for text in pyproject()["project"]["dependencies"]}
    assert core & {library.package for library in OPTIONAL.values()} <= {"pybullet"}


def test_the_extra_all_has_every_other_extra() -> None:
    extras = pyproject()["project"]["optional-dependencies"]
    (everything,) = [Requirement(text) for text in extras["all"]]
    compiled = {"bullet"}  # pip compiles it where there is no wheel
    assert everything.extras == set(extras) - {"all", "dev", "docs"} - compiled


@pytest.mark.parametrize("module", sorted(OPTIONAL))
def test_each_missing_library_is_told_with_its_extra(module: str, without: Callable[..., None]) -> None:
    without(module)
    library = OPTIONAL[module]
    with pytest.raises(LibraryError, match="^This " + sentence(library.extra, library.package) + r", or not\.$"):
        require("This", module, otherwise=", or not")
    assert not is_installed(module)
    assert library.extra in lack_of("This", module)


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("raise ImportError('libtorch_cpu.so: undefined symbol: _ZN3c10')", "ImportError: libtorch_cpu.so: undefined"),
        ("raise OSError('libcudart.so.12: cannot open')", "OSError: libcudart.so.12: cannot open"),
        ("import nosuchlibrary", "ModuleNotFoundError: No module named 'nosuchlibrary'"),
        ("from torch._C import nothing", "ModuleNotFoundError: No module named 'torch._C'"),
        ("def f(:", "SyntaxError: "),
    ],
    ids=["symbol", "shared-object", "dependency", "extension", "syntax"],
)
def test_half_a_library_is_told_with_its_own_error(
    code: str, reason: str, half_installed: Callable[[str, str | None], None]
) -> None:
    half_installed("torch", code)
    assert is_installed("torch")
    with pytest.raises(LibraryError, match=r"^This needs the library torch, which is installed but does not") as it:
        require("This", "torch")
    assert it.match(reason)
    assert it.match("Install it again: pip install --force-reinstall torch")
    assert "\n" not in str(it.value)


def test_a_folder_that_an_uninstallation_left_is_no_library(half_installed: Callable[[str, str | None], None]) -> None:
    half_installed("leftlibrary", None)
    with pytest.raises(LibraryError, match=r"only a folder of its name, .*site/leftlibrary, without the library in it"):
        require("This", "leftlibrary")


def test_a_library_whose_own_optional_library_is_missing_names_that(
    half_installed: Callable[[str, str | None], None], without: Callable[..., None]
) -> None:
    half_installed("sb3_contrib", "import torch")
    without("torch")
    with pytest.raises(LibraryError, match=sentence("train", "torch")):
        require("--algorithm recurrent-ppo", "sb3_contrib")


def test_a_module_of_ours_that_does_not_import_is_no_library() -> None:
    with pytest.raises(ModuleNotFoundError, match="aquanav_tools"), explained_imports("aquanav"):
        import aquanav_tools.nothing  # type: ignore[import-not-found] # noqa: F401


def test_a_library_of_the_core_that_is_missing_is_told() -> None:
    with pytest.raises(LibraryError, match="aquanav-eval needs the library nosuchlibrary, which is not installed"):
        with explained_imports("aquanav-eval"):
            import nosuchlibrary  # type: ignore[import-not-found] # noqa: F401


def write_cloud(folder: Path) -> Path:
    """Points on a tube, as a .ply file."""
    rng = np.random.default_rng(0)
    angle, along = rng.uniform(0.0, 2.0 * np.pi, 3000), rng.uniform(0.0, 8.0, 3000)
    points = np.stack([along, np.cos(angle), np.sin(angle)], axis=1)
    path = folder / "cloud.ply"
    properties = "".join(f"property float {axis}\n" for axis in "xyz")
    rows = "\n".join(" ".join(f"{value:.4f}" for value in point) for point in points)
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{properties}end_header\n{rows}\n")
    return path


def write_photos(folder: Path) -> Path:
    """Three photos of nothing."""
    from PIL import Image

    photos = folder / "photos"
    photos.mkdir()
    for number in range(3):
        Image.new("RGB", (320, 240), (40 * number, 90, 90)).save(photos / f"{number}.jpg")
    return photos


class Case(NamedTuple):
    """A command that lacks a library."""

    command: Any
    words: Callable[[Path], list[object]]
    """Its arguments; there is a scenario `tube` in the folder."""
    taken: str
    """The library."""
    present: tuple[str, ...] = ()
    """Others that it asks for first."""


COMMANDS = {
    "train": Case(train_command, lambda f: ["--scenario", f / "tube"], "torch"),
    "train-memory": Case(
        train_command,
        lambda f: ["--scenario", f / "tube", "--algorithm", "recurrent-ppo", "-o", f / "run"],
        "sb3_contrib",
        LEARNING,
    ),
    "zip": Case(eval_command, lambda f: [REFERENCE_ZIP, "--scenario", f / "tube", "-o", f / "eval"], "torch"),
    "films": Case(
        eval_command,
        lambda f: ["baseline:random", "--scenario", f / "tube", "--episodes", 1, "--film", "-o", f / "eval"],
        "rerun",
    ),
    "replay": Case(eval_command, lambda f: ["replay", f / "tube", "--episode", 0], "rerun"),
    "stress": Case(
        eval_command,
        lambda f: ["stress", "baseline:random", "--scenario", f / "tube", "-o", f / "stress"],
        "cmaes",
    ),
    "cluster": Case(
        eval_command,
        lambda f: ["baseline:random", "--scenario", f / "tube", "--ray", "auto", "-o", f / "eval"],
        "ray",
    ),
    "cloud": Case(build_cave_command, lambda f: [write_cloud(f), "-o", f / "cave"], "open3d"),
    "photos": Case(build_cave_command, lambda f: [write_photos(f), "-o", f / "cave"], "cv2"),
    "photos-poses": Case(build_cave_command, lambda f: [write_photos(f), "-o", f / "cave"], "pycolmap", ("cv2",)),
    "photos-cloud": Case(
        build_cave_command, lambda f: [write_photos(f), "-o", f / "cave"], "open3d", ("cv2", "pycolmap", "torch")
    ),
    "render": Case(info, lambda f: ["render", "--out", f / "photos"], "cv2"),
}


@pytest.mark.parametrize("case", COMMANDS)
def test_each_command_says_in_one_sentence_which_extra_it_lacks(
    case: str, tube_folder: Path, tmp_path: Path, without: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    command, words, taken, present = COMMANDS[case]
    for module in present:
        pytest.importorskip(module, reason=f"aquanav asks for {module} first, which is not installed.")
    monkeypatch.chdir(tmp_path)
    without(taken)
    done = run_here(command.main, *words(tmp_path))
    assert done.returncode == 6
    *_, last = done.stderr.strip().splitlines()
    assert last.startswith("error: ")
    assert re.search(sentence(OPTIONAL[taken].extra, OPTIONAL[taken].package), last)
    assert "Traceback" not in done.stderr


def test_from_python_it_is_the_same_sentence(
    tube_folder: Path, tmp_path: Path, without: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    without("torch", "open3d")
    with pytest.raises(LibraryError, match="^Learning a policy " + sentence("train", "torch")):
        aquanav.train(tube_folder, steps=1000)
    with pytest.raises(LibraryError, match=sentence("train", "torch") + ", or fly it as ONNX"):
        aquanav.load_policy(REFERENCE_ZIP)
    with pytest.raises(LibraryError, match=sentence("train", "torch")):
        aquanav.make_vec_env(tube_folder, 2, kind="sb3")
    with pytest.raises(LibraryError, match=sentence("build", "open3d")):
        aquanav.build_cave(write_cloud(tmp_path), output=tmp_path / "cave")


def test_half_of_torch_is_told_by_the_command_and_from_python(
    tube_folder: Path,
    tmp_path: Path,
    half_installed: Callable[[str, str | None], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    half_installed("torch", "raise OSError('libtorch_cpu.so: file too short')")
    with pytest.raises(LibraryError, match=r"installed but does not load: OSError: libtorch_cpu\.so: file too short"):
        aquanav.train(tube_folder, steps=1000)
    done = run_here(train_command.main, "--scenario", tube_folder)
    assert done.returncode == 6
    assert "OSError: libtorch_cpu.so: file too short" in done.stderr.splitlines()[-1]
    assert (
        policies.choice_text("baseline:reference") == ""
    )  # what is there is used, or told of; nothing else takes its place


def test_an_evaluation_without_rerun_says_that_it_records_nothing(
    tube_folder: Path, tmp_path: Path, without: Callable[..., None]
) -> None:
    without("rerun")
    flags = ("--scenario", tube_folder, "--episodes", 1, "--max-decisions", 20, "-o", tmp_path / "eval")
    done = run_here(eval_command.main, "baseline:random", *flags)
    assert done.returncode == 0, done.stderr
    assert "warning: No episode is recorded. A recording (.rrd) needs the library rerun-sdk" in done.stderr
    assert "pip install 'aquanav[record]'" in done.stderr
    assert {"results.json", "report.html"} <= {path.name for path in (tmp_path / "eval").iterdir()}
    assert list((tmp_path / "eval").glob("*.rrd*")) == []


def test_an_evaluation_without_pyarrow_says_that_the_same_episodes_are_in_its_results(
    tube_folder: Path, tmp_path: Path, without: Callable[..., None]
) -> None:
    folder = tmp_path / "eval"
    folder.mkdir()
    flags = ("--scenario", tube_folder, "--episodes", 2, "--max-decisions", 20, "-o", folder)
    assert run_here(eval_command.main, "baseline:random", *flags).returncode == 0
    assert (folder / "episodes.parquet").exists() == is_installed("pyarrow")
    episodes = json.loads((folder / "results.json").read_text())["episodes"]
    without("pyarrow", "rerun")
    done = run_here(eval_command.main, "baseline:random", *flags)
    assert done.returncode == 0, done.stderr
    assert "episodes.parquet is left out; results.json has the same episodes. " in done.stderr
    assert "needs the library pyarrow, which is not installed" in done.stderr
    assert "pip install 'aquanav[parquet]'" in done.stderr
    assert not (folder / "episodes.parquet").exists()  # an earlier one would be of other episodes
    assert json.loads((folder / "results.json").read_text())["episodes"] == episodes


def test_what_was_flown_without_torch_is_replayed_with_it(
    tube_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("torch", "stable_baselines3", "rerun"):
        pytest.importorskip(module, reason=f"Replays need {module}, which is not installed.")
    flags = ("--scenario", tube_folder, "--episodes", 1, "--max-decisions", 20, "-o", tmp_path / "eval")
    with monkeypatch.context() as patch:
        patch.setattr(policies, "is_installed", lambda module: module != "torch")
        done = run_here(eval_command.main, "baseline:reference", *flags)
        assert "baseline:reference flies as ONNX, since torch is not installed" in done.stdout
    again = run_here(eval_command.main, "replay", tmp_path / "eval", "--episode", 0, "-o", tmp_path / "again.rrd")
    assert again.returncode == 0, again.stderr
    assert "repeats to the bit" in again.stdout


# trimesh asks Python whether COLLADA's reader is there in a way that a blocker would end.
CORE = f"""{BLOCKER}
import sys

sys.meta_path.insert(0, Blocker(*{sorted(set(OPTIONAL) - {"collada", "pybullet"})}))
import aquanav
from aquanav_tools.evaluate.policies import baseline_names

env = aquanav.make_env("tube")
observation, _ = env.reset(seed=0)
env.step(env.action_space.sample())
batch = aquanav.make_vec_env("tube", 3)
batch.reset(seed=0)
batch.step(batch.action_space.sample())
for name in baseline_names():
    aquanav.load_policy(f"baseline:{{name}}")
for backend in ("pybullet", "batch") if {is_installed("pybullet")} else ("batch",):
    aquanav.evaluate("baseline:reference", "tube", episodes=2, max_decisions=40, backend=backend, output=backend)
print(sorted(set(sys.modules) & {set(OPTIONAL) - {"pybullet"}}))
"""


def test_the_core_flies_and_scores_the_reference_policy_without_any_optional_library(
    tube_folder: Path, tmp_path: Path
) -> None:
    done = subprocess.run([sys.executable, "-c", CORE], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
    assert (tmp_path / "batch" / "report.html").is_file()
    assert (tmp_path / "batch" / "results.json").is_file()


def test_a_film_for_pages_needs_no_encoder(tmp_path: Path, without: Callable[..., None]) -> None:
    from aquanav_tools.photograph.video import AnimationFile, VideoFile

    without("av")
    with AnimationFile(tmp_path / "film.webp", 10.0) as film:
        film.write(np.zeros((8, 8, 3), np.uint8))
    assert (tmp_path / "film.webp").stat().st_size > 0
    with pytest.raises(LibraryError, match=sentence("films", "av") + r", or make it a \.webp"):
        VideoFile(tmp_path / "film.mp4", 10.0, (8, 8))


def test_the_doctor_passes_over_what_is_not_installed(
    capsys: pytest.CaptureFixture[str], without: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    without("torch")
    monkeypatch.setattr("aquanav_tools.cli.doctor.TRIALS", {"torch": lambda: "never tried"})
    info.main(["doctor"])
    assert capsys.readouterr().out.split(maxsplit=2) == ["torch", "absent", "pip install 'aquanav[train]'\n"]
