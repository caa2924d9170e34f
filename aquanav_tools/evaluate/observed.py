"""What a policy is to observe, as options name it: one array, or a dictionary of parts by name."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from gymnasium import spaces

from aquanav_tools.errors import InputError
from aquanav_tools.policy.spaces import describe_parts, describe_space, shapes_of
from aquanav_tools.registry import NAME_OF_PART, error_text, import_own, is_own, named_part

NOTHING = "none"
"""Named as the preset of a dictionary that has none; results say so too."""
DICTIONARY = "dictionary"
"""What results call a dictionary that the policy brings itself."""
Parts = dict[str, Any]
ADVICE = (
    "Name what it was trained with: --observation and --sensors, each as NAME=PART where a part goes by another name "
    "than its own (docs/evaluate.md), or --observation module:Name for a dictionary of your own."
)


def parts_maker(observation: str | None, sensors: Sequence[str], *, is_dictionary: bool) -> Callable[[], Parts] | None:
    """Return what makes the parts of a dictionary that options name, anew for each environment; None of one array.

    Args:
        observation: A preset, or module:Name of a dictionary of parts or of a function that returns one; before either
            may stand NAME=. None or NOTHING for no preset.
        sensors: Further parts: sensors, likewise.
        is_dictionary: Whether a dictionary is meant even where no NAME= says so.

    Raises:
        InputError: a name comes twice, or code of the user's own returns no dictionary.
    """
    texts = [text for text in (observation, *sensors) if text is not None]
    given = None
    if observation is not None and is_own(observation):
        given = _own_parts(observation)
    if given is None and not is_dictionary and not any(NAME_OF_PART in text for text in texts):
        return None
    if given is not None or observation == NOTHING:
        texts = list(sensors)
    pairs = [named_part(text) for text in texts]
    names = [name for name, _ in pairs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"Two parts of the observation are called '{twice[0]}'. Give one another name: NAME=PART.")
    if is_dictionary and not names and given is None:
        return None
    return partial(_parts, given, dict(pairs))


def named_observation(observation: str, sensors: Sequence[str], history: Sequence[int]) -> str | None:
    """Return what results say is observed where options named it; None for the preset that a policy's file tells."""
    is_named = bool(sensors) or bool(history) or is_own(observation) or NAME_OF_PART in observation
    return observation if is_named else None


def check_parts(name: str, takes: Mapping[str, tuple[int, ...]], space: spaces.Space[Any]) -> None:
    """Check that a policy's parts are those of an environment.

    Args:
        name: Of the policy.
        takes: The shapes of its parts.
        space: What the environment lets it observe.

    Raises:
        InputError: names or shapes differ; the message has both.
    """
    if not isinstance(space, spaces.Dict):
        raise InputError(
            f"The policy {name} observes a dictionary of {describe_parts(takes)}, and what is named is a "
            f"{describe_space(space)}. {ADVICE}"
        )
    shapes = shapes_of(space)
    if shapes.keys() == takes.keys() and all(_fits(takes[part], shapes[part]) for part in shapes):
        return
    raise InputError(
        f"The policy {name} observes a dictionary of {describe_parts(takes)}, and what is named is one of "
        f"{describe_parts(shapes)}. {ADVICE}"
    )


def _fits(taken: tuple[int, ...], given: tuple[int, ...]) -> bool:
    """Return whether a policy takes a shape: SB3 keeps an image's channels before its sides, cameras behind."""
    return taken == given or (len(given) == 3 and taken == (given[2], *given[:2]))


def _parts(given: Callable[[], Parts] | None, named: Parts) -> Parts:
    own = {} if given is None else given()
    twice = sorted(own.keys() & named.keys())
    if twice:
        raise InputError(f"The dictionary has a part '{twice[0]}', and --sensors names one as well. Leave one out.")
    return own | named


def _own_parts(spec: str) -> Callable[[], Parts] | None:
    """Return what makes a dictionary of the user's own; None where the name means an observation of one array."""
    made = import_own(spec, "observation")
    if isinstance(made, Mapping):
        return partial(dict, made)
    if inspect.isfunction(made) and not hasattr(made, "space"):
        return partial(_called, spec, made)
    return None


def _called(spec: str, function: Callable[[], Any]) -> Parts:
    try:
        parts = function()
    except Exception as cause:  # foreign code
        raise InputError(
            f"{spec} is a function, and asking it for the parts of an observation failed: {error_text(cause)}. It is "
            "called without arguments and returns a dictionary."
        ) from cause
    if not isinstance(parts, Mapping):
        raise InputError(f"{spec} returned a {type(parts).__name__}, and a dictionary of parts is asked for.")
    return dict(parts)
