"""Every benchmark has a smallest size, which `.ci/run` runs."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from eval import smoke
from tests.conftest import REPOSITORY


def test_every_benchmark_takes_the_flag() -> None:
    assert len(smoke.scripts()) > 10
    assert [path.name for path in smoke.scripts() if "parser_of(__doc__)" not in path.read_text()] == []
    assert "eval/smoke.py" in (REPOSITORY / ".ci" / "run").read_text()


@pytest.mark.parametrize(("body", "code"), [("print('x is left out: no x here')", 0), ("raise AttributeError", 1)])
def test_a_benchmark_that_fails_fails_the_run(
    body: str, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "benchmarks").mkdir()
    (tmp_path / "benchmarks" / "one.py").write_text(body)
    monkeypatch.setattr(smoke, "FOLDER", tmp_path)
    monkeypatch.setattr(smoke, "OTHERS", ())
    monkeypatch.setattr(sys, "argv", ["smoke.py"])
    with pytest.raises(SystemExit) as ending:
        smoke.main()
    assert ending.value.code == code
    assert ("x is left out" in capsys.readouterr().out) == (code == 0)
