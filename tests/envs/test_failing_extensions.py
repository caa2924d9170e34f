"""The user's own code that fails, or that is not there: the sentence says what, when and for whom."""

from __future__ import annotations

from typing import Any

import pytest

from aquanav_tools.envs.vector_env import CaveVectorEnv
from aquanav_tools.errors import InputError, OwnCodeError
from aquanav_tools.scenario.schema import Scenario
from tests.envs.test_extensions import CODE, wander
from tests.own_modules import WriteModule, own_module

__all__ = ["own_module"]

FAILING = """
class Bad:
    def terms(self, batch):
        values = np.zeros(batch.num)
        {line}
        return {{"a": values}}
"""
AT_FOUR = "batch.decisions >= np.where(batch.seeds == 8, 4, 1000)"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (f"assert not ({AT_FOUR}).any(), 'far'", r"raised AssertionError: far \(own_\d+\.py, line 8\)"),
        (f"values[{AT_FOUR}] = np.nan", r"returned nan, which is not finite"),
        (
            f"values = values[:-1] if ({AT_FOUR}).any() else values",
            r"returned an array of shape \(0,\), and \(1,\) is asked for",
        ),
        (f"values = values.astype(str) if ({AT_FOUR}).any() else values", r"returned <U32, and numbers are asked for"),
        (
            f"if ({AT_FOUR}).any(): return values",
            r"returned a ndarray, and a dict of terms by their names is asked for",
        ),
        (f"if ({AT_FOUR}).any(): return dict(b=values)", r"returned the terms b, and before a"),
    ],
)
def test_a_reward_that_fails_says_how_when_and_for_whom(
    tube: Scenario, own_module: WriteModule, line: str, words: str
) -> None:
    own = own_module(FAILING.format(line=line))
    envs = CaveVectorEnv(3, tube, reward=f"{own}:Bad")
    envs.reset(seed=[7, 8, 9])
    for n in range(3):
        envs.step(wander(3, n))
    place = rf"The reward {own}:Bad .*{words}, after 4 decisions of the episode\. This was vehicle 1 \(seed 8\), of 3\."
    with pytest.raises(OwnCodeError, match=place) as caught:
        envs.step(wander(3, 3))
    assert list(caught.value.reasons) == [1]


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        ({"sensors": ("OWN:S",)}, "class S:\n    spec = lambda self, s, v: Box(0, 1, (2,))\n"
         "    measure = lambda self, b: np.zeros(b.num)",
         r"The sensor own_\d+:S returned an array of shape \(1,\), and \(1, 2\) is asked for, after 0"),
        ({"observation": "OWN:O"}, "class O:\n    space = Box(0, 1, (2,))\n    __call__ = lambda self, b: b.position",
         r"observation own_\d+:O raised AttributeError: a batch has no array 'position'. Did you mean 'positions'\?"),
        ({"termination": "OWN:rule"}, "rule = lambda batch: batch.decisions",
         r"The termination rule own_\d+:rule returned int32, and bool are asked for"),
        ({"disturbance": "OWN:D"}, "class D:\n    actions = lambda self, b, c: c + 2.0",
         r"The disturbance own_\d+:D returned a command of \d, outside of -1 to 1"),
        ({"motion": "OWN:law"}, "law = lambda states, commands, currents, dt: states[:, :3]",
         r"law of motion own_\d+:law returned an array of shape \(1, 3\), and \(1, 13\) is asked for"),
        ({"motion": "OWN:law"}, "law = lambda states, commands, currents, dt: states * 3.0",
         r"law of motion own_\d+:law returned a quaternion of length 3, not 1"),
        ({"motion": "OWN:law"}, "law = lambda states, commands, currents, dt: states + 2.0 * (np.arange(13) == 1)",
         r"law of motion own_\d+:law moved a vehicle by 2 m in one physics step, more than 1 m"),
        ({"reward": "OWN:R"}, "class R:\n    def terms(self, b):\n        b.positions[0] = 0.0",
         r"The reward own_\d+:R raised ValueError: assignment destination is read-only"),
        ({"reward": "OWN:R"}, "class R:\n    base = 'safe'\n    terms = lambda self, b: {'time': b.clearances}",
         "has a term 'time', as the reward safe has beside it"),
    ],
)  # fmt: skip
def test_whatever_else_fails_is_told_too(
    tube: Scenario, own_module: WriteModule, options: dict[str, Any], code: str, words: str
) -> None:
    own = own_module(code)
    named: dict[str, Any] = {
        name: tuple(one.replace("OWN", own) for one in value) if isinstance(value, tuple) else value.replace("OWN", own)
        for name, value in options.items()
    }
    envs = CaveVectorEnv(2, tube, **named)
    with pytest.raises(OwnCodeError, match=words):
        envs.reset(seed=0)
        envs.step(wander(2, 0))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"reward": "carefull"},
            r"There is no reward 'carefull'. Did you mean 'careful'\? Code of your own is named as ",
        ),
        ({"reward": "OWN:Alonk"}, r"The module own_\d+ has no Alonk. Did you mean 'Along'\?"),
        ({"reward": "no_such:Along"}, "no_such cannot be imported: ModuleNotFoundError"),
        ({"reward": "OWN:Where"}, r"The reward own_\d+:Where is a Where, which has no method `terms`"),
        ({"sensors": ("dept",)}, "There is no sensor 'dept'. Did you mean 'depth'\\? Code of your own is named as "),
        ({"sensors": ("depth", "depth")}, "The sensor depth is named twice"),
        ({"sensors": ("OWN:Own",)}, r"The sensor own_\d+:Own is a Own, which has no method `measure`"),
        ({"observation": "ful"}, "There is no observation preset 'ful'. Did you mean 'full'"),
        ({"observation": "OWN:Where"}, r"The observation own_\d+:Where is a Where, which cannot be called"),
        ({"observation": "OWN:late"}, r"The observation own_\d+:late cannot tell its space: AttributeError"),
        ({"termination": "OWN:Off"}, "which cannot be called"),
        ({"disturbance": "OWN:Own"}, "with neither a method `actions` nor `observations`"),
        ({"disturbance": "OWN:Needy"}, r"OWN:Needy is a class, and making one without arguments failed: TypeError"),
        ({"reward": "OWN:Based"}, r"has the base 'denser', which there is not. Did you mean 'dense'"),
    ],
)
def test_names_that_mean_nothing_are_refused(
    tube: Scenario, own_module: WriteModule, options: dict[str, Any], words: str
) -> None:
    more = "class Needy:\n    def __init__(self, x): pass\nclass Based(Along):\n    base = 'denser'\n"
    own = own_module(CODE + more)
    named: dict[str, Any] = {
        name: tuple(one.replace("OWN", own) for one in value) if isinstance(value, tuple) else value.replace("OWN", own)
        for name, value in options.items()
    }
    with pytest.raises(InputError, match=words.replace("OWN", own)):
        CaveVectorEnv(2, tube, **named)
