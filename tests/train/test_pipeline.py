from __future__ import annotations

from pathlib import Path

import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.scenario.shipped import BAYS, scenario_names
from aquanav_tools.scenario.split import distribution_of
from aquanav_tools.shipped import shipped_names
from aquanav_tools.train.pipeline import FOLDER, check_settings, read_pipeline

CAVE = {"scenario": "cave-train-1"}


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", shipped_names(FOLDER))
def test_every_shipped_pipeline_is_valid(name: str) -> None:
    pipeline = read_pipeline(name, CAVE if name == "quick" else {})
    assert pipeline.steps > 0
    used = {*pipeline.run.validation, *(name for lesson in pipeline.lessons for name in lesson.all_scenarios)}
    fixed = {name for name in used if distribution_of(name) is None}
    assert fixed <= {*scenario_names(), *shipped_names(BAYS)}


def test_the_papers_lessons_are_the_originals() -> None:
    # Section 3 of the original's contract: 1.5, 1.0 and 0.5 million decisions, water, learning rate, clip.
    lessons = read_pipeline("paper", {}).lessons
    assert [lesson.steps for lesson in lessons] == [1_500_000, 1_000_000, 500_000]
    assert [lesson.current for lesson in lessons] == ["still", "half", "full"]
    assert [lesson.learning_rate for lesson in lessons] == [3e-4, 3e-4, 1.5e-4]
    assert [lesson.clip for lesson in lessons] == [0.2, 0.1, 0.1]
    assert {(lesson.rollout_size, lesson.batch, lesson.schedule) for lesson in lessons} == {(20480, 1024, "original")}
    whole = read_pipeline("paper-end-to-end", {}).lessons
    assert [(lesson.steps, lesson.current, lesson.learning_rate, lesson.clip) for lesson in whole] == [
        (3_000_000, "full", 3e-4, 0.2)
    ]


def test_variants_differ_from_the_paper_in_what_they_are_called_by() -> None:
    paper = read_pipeline("paper", {}).lessons
    for name, said in [
        ("paper-clip-01", {"clip": 0.1}),
        ("paper-clip-02", {"clip": 0.2}),
        ("paper-sparse", {"reward": "sparse"}),
        ("paper-safe", {"reward": "safe"}),
        ("paper-careful", {"reward": "careful"}),
    ]:
        assert read_pipeline(name, {}).lessons == read_pipeline("paper", said).lessons != paper


def test_no_pipeline_trains_or_chooses_on_a_test_cave() -> None:
    for name in shipped_names(FOLDER):
        pipeline = read_pipeline(name, CAVE if name == "quick" else {})
        used = {*pipeline.run.validation, *(name for lesson in pipeline.lessons for name in lesson.all_scenarios)}
        assert not any(cave.startswith("cave-test") for cave in used)


def test_what_is_said_later_counts(tmp_path: Path) -> None:
    write(
        tmp_path, "base", 'scenario = "a"\nclip = 0.3\nworkers = 2\n[[lessons]]\nclip = 0.1\n[[lessons]]\nsteps = 7\n'
    )
    middle = write(tmp_path, "middle", 'extends = "base.toml"\nsteps = 9\n')
    lessons = read_pipeline(middle, {}).lessons
    assert [(lesson.clip, lesson.steps) for lesson in lessons] == [(0.1, 9), (0.3, 9)]
    top = write(tmp_path, "top", 'extends = "middle.toml"\nclip = 0.2\n[[lessons]]\nsteps = 5\n')
    pipeline = read_pipeline(top, {"ent_coef": 0.5})
    assert [(lesson.clip, lesson.steps, lesson.ent_coef) for lesson in pipeline.lessons] == [(0.2, 5, 0.5)]
    assert pipeline.run.workers == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('scenaro = "a"', "mine.toml has the unknown key 'scenaro'. Did you mean 'scenario'"),
        ("steps = 10", "Lesson 1 names no scenario"),
        ('scenario = "a"\nlessons = []', "lessons must be tables [[lessons]], at least one"),
        ('scenario = "a"\n[[lessons]]\n[[lessons]]\nhidden = [3]', "hidden is (128, 128, 128) in lesson 1 and (3,)"),
        ('scenario = "a"\n[[lessons]]\n[[lessons]]\nclip = -1.0', "lesson 2: clip must be positive, got -1.0"),
        ('extends = "papr"', "aquanav ships no 'papr' in pipelines/train. Did you mean 'paper'"),
        ('extends = "other.toml"', "There is no file other.toml. Shipped pipelines:"),
        ('extends = "mine.toml"', "extends more than 8 files. Do they extend one another in a circle?"),
        ("extends = 3", "extends must be a name or a path, not 3"),
        ('scenario = "a"\nvalidate_every = 0', "validate_every must be positive, got 0"),
    ],
)
def test_senseless_pipelines_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        read_pipeline(write(tmp_path, "mine", text), {})
    assert message in str(error.value)


@pytest.mark.parametrize("text", ["trace = 0.9", "[[lessons]]\nscenario = 'cave-train-1'\ntrace = 0.9"])
def test_setting_by_its_old_name_is_refused_with_the_new_one(text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"own\.toml has the key 'trace', which is called gae_lambda now"):
        read_pipeline(write(tmp_path, "own", text), CAVE)


@pytest.mark.parametrize(
    ("text", "said", "advice"),
    [
        ('scenario = "a"\nbuffer = 20_480', {}, r"Write n_steps = 2560 \(20480 / 8 environments\)"),
        ('scenario = "a"\nbuffer = 20_480\nnum_envs = 16', {}, r"Write n_steps = 1280 \(20480 / 16 environments\)"),
        ('buffer = 20_480\n[[lessons]]\nscenario = "a"', {"num_envs": 512}, r"Write n_steps = 40 \("),
        ('extends = "paper"\nbuffer = 20_480', {}, r"Write n_steps = 1280 \("),
        ('extends = "paper-batch"\nbuffer = 40_960', {}, r"Write n_steps = 80 \("),
        ('[[lessons]]\nscenario = "a"\nnum_envs = 4\nbuffer = 128', {}, r"Write n_steps = 32 \("),
        ('scenario = "a"\nbuffer = 100\nnum_envs = 16', {}, r"Write n_steps = 100 / 16 in its place"),
    ],
)
def test_a_buffer_is_refused_with_the_steps_of_each_environment(
    text: str, said: dict[str, int], advice: str, tmp_path: Path
) -> None:
    with pytest.raises(
        InputError, match=r"own\.toml has the key 'buffer', which counted decisions over all .*" + advice
    ):
        read_pipeline(write(tmp_path, "own", text), said)


def test_a_buffer_in_a_file_that_is_extended_goes_by_the_environments_of_the_one_that_extends_it(
    tmp_path: Path,
) -> None:
    write(tmp_path, "base", 'scenario = "a"\nnum_envs = 4\nbuffer = 128\n')
    with pytest.raises(InputError, match=r"base\.toml has the key 'buffer'.* n_steps = 16 \(128 / 8"):
        read_pipeline(write(tmp_path, "own", 'extends = "base.toml"\nnum_envs = 8'), {})


def test_settings_by_name_refuse_a_buffer_with_the_steps_of_each_environment() -> None:
    with pytest.raises(InputError, match=r"train has the key 'buffer'.* n_steps = 128 \(256 / 2 environments\)"):
        check_settings({"buffer": 256, "num_envs": 2}, "train")
    with pytest.raises(InputError, match=r"train has the key 'buffer'.* n_steps = 256 / num_envs in its place"):
        check_settings({"buffer": 256}, "train")
