"""The command `aquanav`: versions, health, and what ships."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import pytest

from aquanav_tools import __version__
from aquanav_tools.cli import doctor, info
from aquanav_tools.sim.vehicle import VEHICLE_DIR, known_vehicles
from tests.project import commands

NAMES = {"build": "aquanav-build-cave", "train": "aquanav-train", "eval": "aquanav-eval"}
LONG = {short: commands()[name].split(":")[0] for short, name in NAMES.items()}


def test_info_names_the_version_of_aquanav_and_of_each_library(capsys: pytest.CaptureFixture[str]) -> None:
    info.main(["info"])
    rows = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert rows["aquanav"] == __version__
    assert rows["numpy"] == importlib.metadata.version("numpy")


def test_info_says_which_library_is_missing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(info, "PACKAGES", ("no-such-package",))
    info.main(["info"])
    assert "no-such-package    not installed" in capsys.readouterr().out


def test_info_on_a_vehicle_says_what_it_can_do(capsys: pytest.CaptureFixture[str]) -> None:
    info.main(["info", "original-auv"])
    printed = capsys.readouterr().out
    assert "1.96 m/s ahead, 0.98 m/s in reverse" in printed  # the original's table
    assert "3.04 rad/s" in printed


def test_info_refuses_a_vehicle_that_makes_no_sense(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    text = (VEHICLE_DIR / "bluerov2.toml").read_text().replace("mass = 11.5 ", "mass = -1.0 ")
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(SystemExit) as exit_info:
        info.main(["info", str(tmp_path / "mine.toml")])
    assert exit_info.value.code == 2
    assert "mine.toml: body: mass must be positive, got -1" in capsys.readouterr().err


def test_list_names_the_shipped_vehicles_and_the_baselines(capsys: pytest.CaptureFixture[str]) -> None:
    info.main(["list"])
    lines = capsys.readouterr().out.splitlines()
    rows = [line.rsplit(maxsplit=1) for line in lines]
    vehicles = {line.split()[1]: line for line in lines if line.startswith("vehicle")}
    assert set(vehicles) == set(known_vehicles())
    assert "13.5 kg, 0.57 m long, 0.61 m/s ahead, 8 thrusters" in vehicles["bluerov2-heavy"]
    assert ["baseline", "baseline:reactive"] in rows
    assert ["baseline", "baseline:random"] in rows
    assert ["baseline", "baseline:oracle"] in rows
    assert any(line.startswith("shield ") and "shield:POLICY" in line for line in lines)


def test_list_names_every_recipe(capsys: pytest.CaptureFixture[str]) -> None:
    info.main(["list"])
    listed = capsys.readouterr().out.split()
    for folder in info.CONTENT.values():
        assert set(listed) >= {path.stem for path in (Path(__file__).parents[2] / folder).glob("*.toml")}


def test_a_well_library_is_found_well() -> None:
    assert doctor.examine("manifold3d") == doctor.Finding("manifold3d", True, "a cube of volume 1")


def fail() -> str:
    """Stand in for a library that does not import."""
    raise ImportError("libusb-1.0.so.0: cannot open shared object file")


def abort() -> str:
    """Stand in for a library that ends the process."""
    os.abort()


def test_a_library_that_does_not_import_is_found_ill_with_the_reason() -> None:
    finding = doctor.examine("broken", {"broken": fail})
    assert not finding.is_well
    assert "libusb-1.0.so.0" in finding.detail


def test_a_library_that_aborts_does_not_take_the_doctor_along() -> None:
    finding = doctor.examine("broken", {"broken": abort})
    assert not finding.is_well
    assert "code -6" in finding.detail


def test_doctor_exits_with_6_and_says_what_to_do_when_a_library_fails(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {"broken": fail})
    monkeypatch.setattr(doctor, "examine", lambda library: doctor.Finding(library, False, "no such file"))
    with pytest.raises(SystemExit) as exit_info:
        info.main(["doctor"])
    assert exit_info.value.code == 6
    printed = capsys.readouterr()
    assert "FAILED  no such file" in printed.out
    assert "1 of 1 libraries do not work here: broken." in printed.err
    assert "pip install" in printed.err


def test_doctor_tells_machines_without_a_place_to_write_to_from_broken_libraries(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    details = {  # as Warp and matplotlib say it
        "warp": "OSError: [Errno 30] Read-only file system: '/home/me/.cache'",
        "matplotlib": "OSError: Matplotlib requires access to a writable cache directory, but there was an issue",
    }
    monkeypatch.setattr(doctor, "TRIALS", dict.fromkeys(details, fail))
    monkeypatch.setattr(doctor, "examine", lambda library: doctor.Finding(library, False, details[library]))
    with pytest.raises(SystemExit) as exit_info:
        info.main(["doctor"])
    assert exit_info.value.code == 6
    told = capsys.readouterr().err
    assert "They find no folder that they can write to. Set HOME or TMPDIR" in told and "pip install" not in told


def test_a_misspelt_subcommand_ends_with_code_2_and_no_traceback() -> None:
    command = Path(sys.executable).with_name("aquanav")
    done = subprocess.run([command, "docter"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "doctor" in done.stdout + done.stderr
    assert "Traceback" not in done.stderr


def test_version_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    info.main(["--version"])
    assert capsys.readouterr().out == f"aquanav {__version__}\n"


@pytest.mark.parametrize(("short", "module"), sorted(info.COMMANDS.items()))
def test_short_subcommands_are_the_long_commands(
    short: str, module: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    helps = []
    for main, words in ((info.main, [short, "--help"]), (importlib.import_module(LONG[short]).main, ["--help"])):
        with pytest.raises(SystemExit) as ending:
            main(words)
        assert ending.value.code == 0
        helps.append(capsys.readouterr().out)
    assert helps[0] == helps[1] != ""
    handed: list[list[str]] = []
    monkeypatch.setattr(f"aquanav_tools.cli.{module}.main", handed.append)
    info.main(["--debug", short, "x", short, "--flag"])
    assert handed == [["--debug", "x", short, "--flag"]]


def test_help_names_the_short_subcommands(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        info.main(["--help"])
    printed = capsys.readouterr().out
    assert all(f"{short} " in printed and command in printed for short, command in NAMES.items())
