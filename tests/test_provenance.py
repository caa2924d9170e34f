"""A stage's key follows the code that the stage runs, wherever that lies, and no other code."""

from __future__ import annotations

import ast
import functools
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

from aquanav_tools import provenance
from aquanav_tools.build.cave_stages import _close, build_scenario
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.output_folder import PHOTO_CODE
from aquanav_tools.provenance import code_digest, used_code
from aquanav_tools.scenario.shipped import BUILDER, GENERATOR
from aquanav_tools.synthetic.caves import tube
from aquanav_tools.types import silent

PACKAGE = Path(provenance.__file__).parent
STAGES: dict[str, tuple[Any, ...]] = {
    "closed": (_close,), "cave": (build_scenario,), "drawn": GENERATOR, "shipped": BUILDER, "photos": PHOTO_CODE,
}  # fmt: skip


def stages_changed_by(monkeypatch: pytest.MonkeyPatch, *places: str) -> set[str]:
    """Return the stages whose keys change with all functions and classes in some files or folders of the package."""
    before = {name: code_digest(*roots) for name, roots in STAGES.items()}
    original = provenance._read_source
    assert all((PACKAGE / place).exists() for place in places)

    @functools.cache  # asked for at every reference that is followed
    def read(path: Path) -> str:
        text = original(path)
        if not any(path.is_relative_to(PACKAGE / place) for place in places):
            return text
        tree = ast.parse(text)
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                node.body.append(ast.Pass())
        return ast.unparse(tree)

    with monkeypatch.context() as patched:
        patched.setattr(provenance, "_read_source", read)
        after = {name: code_digest.__wrapped__(*roots) for name, roots in STAGES.items()}  # past its cache
    return {name for name in STAGES if before[name] != after[name]}


def test_a_changed_plot_rebuilds_no_cave(monkeypatch: pytest.MonkeyPatch) -> None:
    drawing = "report", "build/cave_report.py", "build/photo_report.py", "build/recipe.py"
    assert stages_changed_by(monkeypatch, *drawing) == set()
    others = "api", "benchmark", "cli", "envs", "evaluate", "policy", "train", "export", "deploy"
    assert stages_changed_by(monkeypatch, *others) == set()


def test_a_changed_start_placement_recloses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert stages_changed_by(monkeypatch, "cave/route/starts.py") == {"cave", "drawn", "shipped", "photos"}
    assert stages_changed_by(monkeypatch, "cave/water/flow.py") == {"cave", "drawn", "shipped", "photos"}


def test_what_a_stage_uses_changes_its_key(monkeypatch: pytest.MonkeyPatch) -> None:
    assert {"closed", "cave", "photos"} == stages_changed_by(monkeypatch, "cave/closing/portals.py")
    assert stages_changed_by(monkeypatch, "synthetic/styles/drawing.py") == {"drawn"}
    assert stages_changed_by(monkeypatch, "synthetic/galleries.py") == {"shipped"}
    assert stages_changed_by(monkeypatch, "reconstruct/fusion.py") == {"photos"}
    assert stages_changed_by(monkeypatch, "scenario/folder.py") == {"drawn", "shipped", "photos"}


def write_modules(folder: Path, monkeypatch: pytest.MonkeyPatch, **texts: str) -> None:
    """Take a folder with these modules for the package."""
    for name, text in texts.items():
        (folder / f"{name}.py").write_text(text)
    monkeypatch.setattr(provenance, "_PACKAGE", folder)
    for cached in (code_digest, provenance._source_of, provenance._read_source):
        cached.cache_clear()


CALLER = """
import numpy as np
from toy.other import helper, untouched
from toy import third

LIMIT = 3

def root(x: int) -> float:
    '''Text.'''
    return helper(x) + LIMIT + third.scale(x)

def beside():
    import scipy
    return untouched
"""
OTHER = "def helper(x):\n    return x\n\ndef untouched():\n    return 1\n"
THIRD = "FACTOR = 2\n\ndef scale(x):\n    return FACTOR * x\n\ndef other():\n    return 0\n"


@pytest.mark.parametrize(
    ("changes", "is_other"),
    [
        ({"caller": CALLER.replace("Text.", "Other words.")}, False),
        ({"caller": "# words\n" + CALLER}, False),
        ({"caller": CALLER.replace("return untouched", "return 5")}, False),
        ({"other": OTHER.replace("return 1", "return 2")}, False),
        ({"third": THIRD.replace("return 0", "return 9")}, False),
        ({"caller": CALLER.replace("LIMIT = 3", "LIMIT = 4")}, True),
        ({"caller": CALLER.replace("x: int", "x: float")}, True),  # declarations are read when kept values are
        ({"other": OTHER.replace("return x", "return -x")}, True),
        ({"third": THIRD.replace("FACTOR = 2", "FACTOR = 3")}, True),
        ({"third": THIRD + "print('on import')\n"}, True),
    ],
)
def test_only_what_is_reached_counts(
    changes: dict[str, str], is_other: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "toy"
    folder.mkdir()
    texts = {"__init__": "", "caller": CALLER, "other": OTHER, "third": THIRD}
    write_modules(folder, monkeypatch, **texts)
    before = code_digest("toy.caller:root")
    assert used_code("toy.caller:root")[1] == set()  # neither numpy, which nothing uses, nor scipy
    write_modules(folder, monkeypatch, **{**texts, **changes})
    assert (code_digest("toy.caller:root") != before) == is_other
    with pytest.raises(ValueError, match="defines no rot"):
        code_digest("toy.caller:rot")
    monkeypatch.undo()
    for cached in (code_digest, provenance._source_of, provenance._read_source):
        cached.cache_clear()


def test_libraries_count_with_their_versions(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "numpy" in used_code(_close)[1] and "torch" not in used_code(_close)[1]
    found = []
    for version in ("98", "99"):
        monkeypatch.setattr(provenance, "installed_version", lambda name, v=version: v if name == "numpy" else "1")
        code_digest.cache_clear()
        found.append(code_digest(_close))
    code_digest.cache_clear()
    assert found[0] != found[1]


def test_code_is_followed_once_for_all_processes_while_no_file_changes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("AQUANAV_CACHE", str(tmp_path / "cache"))
    first, follow = code_digest.__wrapped__(_close), provenance.used_code
    followed: list[object] = []
    monkeypatch.setattr(provenance, "used_code", lambda *roots: followed.append(roots) or follow(*roots))
    assert code_digest.__wrapped__(_close) == first and not followed
    read = provenance._read_source
    monkeypatch.setattr(provenance, "_read_source", lambda path: read(path) + "# another file\n")
    assert code_digest.__wrapped__(_close) == first and len(followed) == 1  # comments are no code
    (tmp_path / "cache" / provenance.KEYS_FILE).write_text("{", encoding="utf-8")  # torn
    assert code_digest.__wrapped__(_close) == first and len(followed) == 2


def is_imported(frame: FrameType | None) -> bool:
    """Return whether a module that is being imported runs it: what that defines there counts where it is used."""
    while frame is not None and frame.f_code is not build_scenario.__code__:
        if frame.f_code.co_name == "<module>":
            return True
        frame = frame.f_back
    return False


def test_every_function_that_a_build_runs_is_among_the_code_it_is_said_to_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The truth is what Python itself calls while a damaged tube is closed and made a scenario."""
    monkeypatch.setattr("aquanav_tools.cave.water.flow.FEW_CELLS", 20_000)  # it takes longer while it is watched
    ran: set[tuple[str, str]] = set()

    def note(frame: FrameType, event: str, _argument: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(str(PACKAGE)):
            name = code.co_qualname if sys.version_info >= (3, 11) else code.co_name
            place = (frame.f_globals.get("__name__", ""), name.split(".")[0])  # none where a library compiles it
            if place not in ran and not is_imported(frame):
                ran.add(place)

    scan = tube(1.0, 6.0, sections=32, rings=31).mesh
    is_kept = np.ones(len(scan.faces), dtype=bool)
    is_kept[700:712] = False
    scan = type(scan)(scan.vertices, scan.faces[is_kept])
    options = BuildOptions(tmp_path / "tube.stl", tmp_path / "out")
    sys.setprofile(note)
    try:
        build_scenario(scan, options, Journal(silent))
    finally:
        sys.setprofile(None)
    called = {(module, name) for module, name in ran if module and not name.startswith("<")}
    if sys.version_info < (3, 11):  # methods have no class in their name there
        called = {(module, name) for module, name in called if name in vars(sys.modules[module])}
    reached, _ = used_code(build_scenario)
    assert len(called) > 150
    assert sorted(called - reached) == []
