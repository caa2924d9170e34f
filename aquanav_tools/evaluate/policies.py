"""Policies by name: files of several kinds, the user's own code, baselines, and what is put around any of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.action import choices_of as choices_of_commands
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.evaluate.boat_oracle import BoatOracle
from aquanav_tools.evaluate.ml_agents import SUFFIX, MlAgentsPolicy
from aquanav_tools.evaluate.network import NetworkPolicy
from aquanav_tools.evaluate.observed import ADVICE, NOTHING, check_parts, parts_maker
from aquanav_tools.evaluate.options import ProtocolOptions
from aquanav_tools.evaluate.oracle import OraclePolicy
from aquanav_tools.evaluate.own_code import CallablePolicy, OwnPolicy
from aquanav_tools.evaluate.policy_kinds import BatchPrivileged, Policy, PrivilegedPolicy
from aquanav_tools.evaluate.presets import CAVE, fitting_form, fitting_presets
from aquanav_tools.evaluate.reactive import ReactivePolicy
from aquanav_tools.evaluate.shielding import SHIELD, inner_of, shielded
from aquanav_tools.evaluate.trusted import TORCHSCRIPT, TorchScriptPolicy, TrustedPolicy
from aquanav_tools.libraries import is_installed
from aquanav_tools.policy.architecture import ExoticPolicyError
from aquanav_tools.policy.archive import TRAINED
from aquanav_tools.policy.observed import Observed, Options
from aquanav_tools.policy.run_folder import KINDS, best_policy, observed_in
from aquanav_tools.policy.spaces import describe_parts, describe_space, shapes_of
from aquanav_tools.provenance import file_hash
from aquanav_tools.registry import is_own
from aquanav_tools.shipped import shipped_names, shipped_path
from aquanav_tools.sim.command import DIVING, NUM_CHOICES
from aquanav_tools.task import TaskOptions, choices_of
from aquanav_tools.types import IntArray

PREFIX = "baseline:"


FilePolicy = MlAgentsPolicy | NetworkPolicy | TrustedPolicy | TorchScriptPolicy


@dataclass(frozen=True)
class LoadedPolicy:
    """A policy and what it needs of the environment."""

    policy: Policy
    name: str
    """Name of the file, or of the baseline."""
    sha256: str | None
    """Of the file; None for a baseline that is a program."""
    observation: str
    """Preset it observes; what options name, where that is a dictionary of parts."""
    action: str
    """Form in which it acts."""
    task: str | None = None
    """Which it was made for; None for any."""
    draws: bool = False
    """Whether it may draw at random, which of code that is not ours nobody knows."""
    size: int | None = None
    """Values that it observes, where that is to be held against the environment's; None where it fits a preset."""
    takes: Mapping[str, tuple[int, ...]] | None = None
    """Shapes of the parts that its file says it observes; None of a policy that observes one array, or any."""
    parts: Callable[[], dict[str, Any]] | None = None
    """Makes the parts that it is to observe; None where `observation` names one array."""
    observed: Observed | None = None
    """What its file says that it observes; None where that is named, or told by the number of values."""

    def rules(self, options: Options) -> Options:
        """Return the options of a task in which the policy is let observe what its file says."""
        return options if self.observed is None else self.observed.rules(options)

    def reset(self, seed: int) -> None:
        """Begin an episode; random numbers, if any, are drawn from `seed`."""
        self.policy.reset(seed)

    def act(self, observation: Any) -> Any:
        """Return the action, in the form `action`, for one observation: (O,) of a preset, or a dictionary of arrays."""
        return self.policy.act(observation)


class RandomPolicy:
    """Draws each choice evenly: the floor that any policy must beat."""

    def __init__(self) -> None:
        self._rng, self._num = np.random.default_rng(0), len(DIVING)

    def adapt(self, space: spaces.Space[Any]) -> None:
        """Draw as many choices as a MultiDiscrete space has."""
        assert isinstance(space, spaces.MultiDiscrete)
        self._num = len(space.nvec)

    def reset(self, seed: int) -> None:
        """Begin the sequence that belongs to `seed`."""
        self._rng = np.random.default_rng(seed)

    def act(self, observation: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Return choices from 0 to 2, whatever is observed."""
        return self._rng.integers(NUM_CHOICES, size=self._num)


class MapPolicy:
    """Knows the map, under water or on it: the ceiling."""

    def __init__(self) -> None:
        self._diving, self._afloat = OraclePolicy(), BoatOracle()
        self._active: OraclePolicy | BoatOracle = self._diving

    def bind(self, env: Any) -> None:
        """Look at the map of an environment."""
        if isinstance(env, SurfaceEnv):
            self._active = self._afloat
            self._afloat.bind(env)
        else:
            self._active = self._diving
            self._diving.bind(env)

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._active.reset(seed)

    def act(self, observation: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Return the choices of whoever knows this kind of map."""
        return self._active.act(observation)

    def within(self, batch: Any) -> BatchMapPolicy:
        """Return what chooses for the vehicles of a batch of caves."""
        return BatchMapPolicy(batch)


class BatchMapPolicy:
    """Knows the maps of a batch, whose own oracle it asks (`CaveBatch.advice`)."""

    def __init__(self, batch: Any) -> None:
        self._batch = batch

    def reset(self, seed: int) -> None:
        """Begin an episode: the batch knows when one does."""

    def act(self, observation: Any) -> Any:
        """Refuse: what one vehicle observes tells nothing of the map."""
        raise TypeError("it chooses for all vehicles of its batch at once")

    def logits(self, observations: Any, slots: IntArray) -> npt.NDArray[Any]:
        """Return the (N, 3) choices for vehicles in (N,) slots."""
        return choices_of_commands(self._batch.advice())[slots]

    def decide(self, logits: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the choices, which are those of a row."""
        return logits


BASELINES: dict[str, type[ReactivePolicy] | type[RandomPolicy] | type[MapPolicy]] = {
    "reactive": ReactivePolicy,
    "random": RandomPolicy,
    "oracle": MapPolicy,
}


def policy_loader(options: ProtocolOptions, *, is_trusted: bool) -> Callable[[str], LoadedPolicy]:
    """Return what loads policies for an evaluation; it travels to other processes."""
    observation, sensors, history = options.observation, tuple(options.sensors), tuple(options.history)
    return partial(load_policy, is_trusted=is_trusted, observation=observation, sensors=sensors, history=history)


def check_batched(policy: LoadedPolicy, *, is_diving: bool, otherwise: str) -> None:
    """Check that a policy can run in a batch.

    Args:
        policy: The policy.
        is_diving: Whether all vehicles of the batch are in caves.
        otherwise: What to do where it cannot: a sentence.

    Raises:
        InputError: it looks at its environment, and not at a batch of these.
    """
    knows_batch = is_diving and isinstance(policy.policy, BatchPrivileged)
    if isinstance(policy.policy, PrivilegedPolicy) and not knows_batch:
        seen = "its own vehicle or at the map" if is_diving else "the map of a bay"
        raise InputError(f"{policy.name} looks at {seen}, which it cannot in a batch. {otherwise}")


def code_of(spec: str) -> str:
    """Return the module:function that a policy's name means, also inside a shield; empty of all others."""
    inner = inner_of(spec)
    return inner if is_own(inner) and not inner.startswith(PREFIX) else ""


def load_policy(
    spec: str,
    is_trusted: bool = False,
    observation: str | None = None,
    sensors: tuple[str, ...] = (),
    history: tuple[int, ...] = (),
) -> LoadedPolicy:
    """Return the policy named by `spec`.

    Args:
        spec: A path of an SB3 zip, of an ONNX file, of TorchScript or of a training run's folder; module:function; a
            baseline; or "shield:" before any of these.
        is_trusted: Whether files may run code while they are loaded and used. What can be loaded without is, all the
            same.
        observation: What a file's policy observes; None takes what the file says, or tells it by the number of values.
        sensors: What it observes beside that.
        history: The earlier decisions that it observes.

    Raises:
        InputError: no such baseline (with the closest name), or the file is missing, damaged, unsafe or for another
            task.
    """
    if spec.startswith(SHIELD):
        return shielded(load_policy(spec.removeprefix(SHIELD), is_trusted, observation, sensors, history))
    if spec.startswith(PREFIX):
        _refuse_parts(spec, observation, sensors)
        return _baseline(spec)
    if is_own(spec):
        return observing(own_policy(OwnPolicy(spec), spec), observation, sensors)
    path, name = Path(spec), Path(spec).name
    if path.is_dir():
        path = best_policy(path)
        name = f"{path.resolve().parent.name}/{path.name}"
    found = _load_file(path, is_trusted)
    draws = isinstance(found, TrustedPolicy | TorchScriptPolicy)
    if isinstance(found.observation_space, spaces.Dict):
        form = fitting_form(found.action_space, spec, describe_space(found.observation_space))
        takes = shapes_of(found.observation_space)
        loaded = LoadedPolicy(found, name, file_hash(path), "full", form, CAVE, draws, takes=takes)
        return observing(loaded, observation, sensors)
    _refuse_parts(name, observation, sensors)
    told = (
        observed if (observed := getattr(found, "observed", None)) and not (observation or sensors or history) else None
    )
    named = told.observation if told else observation or ("full" if sensors or history else None)
    return replace(_of_one_array(found, path, name, spec, draws, named), observed=told)


def _of_one_array(
    found: FilePolicy, path: Path, name: str, spec: str, draws: bool, observation: str | None
) -> LoadedPolicy:
    """Return a file's policy that observes one array, with the preset, or what is named in its place."""
    try:
        fit = fitting_presets(found.observation_space, found.action_space, spec, observation)
    except InputError as cause:
        raise InputError(f"{cause}{observed_in(Path(spec))}") from cause
    size = None if observation is None else spaces.flatdim(found.observation_space)
    return LoadedPolicy(found, name, file_hash(path), fit.observation, fit.action, fit.task, draws, size)


def _refuse_parts(name: str, observation: str | None, sensors: Sequence[str]) -> None:
    """Refuse a dictionary for a policy that observes one array."""
    if parts_maker(observation, sensors, is_dictionary=False) is not None:
        raise InputError(
            f"The policy {name} observes one array of values, and what is named is a dictionary of parts. Leave out "
            "NAME=: the values of --sensors then follow those of --observation."
        )


def observing(policy: LoadedPolicy, observation: str | None, sensors: Sequence[str]) -> LoadedPolicy:
    """Return a policy of the user's own, or one that observes a dictionary, with what options say that it observes."""
    if observation is None and not sensors:
        return policy
    parts = parts_maker(observation, sensors, is_dictionary=policy.takes is not None or policy.parts is not None)
    if parts is None:
        return policy if observation is None else replace(policy, observation=observation, parts=None)
    return replace(policy, observation=observation or NOTHING, parts=parts)


def observed_by(policy: LoadedPolicy, task: TaskOptions) -> dict[str, Any]:
    """Return the options of the environment that a policy runs in under the rules of a task."""
    choices = {"observation": policy.observation, "action": policy.action, **choices_of(task)}
    return choices if policy.parts is None else {**choices, "observation": policy.parts(), "sensors": ()}


def check_named(policy: LoadedPolicy) -> None:
    """Refuse a policy that observes a dictionary where nobody says of what, before anything runs.

    Raises:
        InputError: nobody does; the message has its parts.
    """
    if policy.takes is not None and policy.parts is None:
        raise InputError(
            f"The policy {policy.name} observes a dictionary of {describe_parts(policy.takes)}, and its file does not "
            f"say what measures them. {ADVICE}"
        )


def check_size(policy: LoadedPolicy, space: spaces.Space[Any]) -> None:
    """Check that a policy takes what an environment lets it observe.

    Raises:
        InputError: it takes another number of values, or other parts.
    """
    if policy.takes is not None:
        check_parts(policy.name, policy.takes, space)
    size = spaces.flatdim(space)
    if policy.size not in (None, size):
        raise InputError(
            f"The policy {policy.name} takes {policy.size} values, and there are {size} of the observation "
            f"{policy.observation} with the sensors and the history that are named. Name with --observation, --sensors "
            "and --history what it was trained with."
        )


def own_policy(own: CallablePolicy, name: str) -> LoadedPolicy:
    """Return the user's own code as a policy of some name."""
    sha256 = file_hash(own.path) if own.path else None
    parts: Callable[[], dict[str, Any]] | None = None if own.parts is None else own.parts.copy
    return LoadedPolicy(own, name, sha256, own.observation, own.action, draws=True, parts=parts)


def choice_text(spec: str) -> str:
    """Return which file is taken where `spec` leaves that open: a run's folder, a trained baseline without torch."""
    inner = inner_of(spec)
    if inner.startswith(PREFIX) and inner.removeprefix(PREFIX) in shipped_names(*TRAINED) and not is_installed("torch"):
        return f"{inner} flies as ONNX, since torch is not installed: the same network, computed in another order."
    folder = Path(inner)
    if not folder.is_dir():
        return ""
    name = best_policy(folder).name
    return f"{folder} is a training run's folder. Its {name} is taken: {KINDS[name]}."


def recorded_spec(spec: str, sha256: str | None) -> str:
    """Return what loads the policy of some results: of a trained baseline the file that flew, with torch or without."""
    inner, folder = inner_of(spec), TRAINED[0]
    if inner.startswith(PREFIX) and (name := inner.removeprefix(PREFIX)) in shipped_names(*TRAINED):
        for suffix in (TRAINED[1], SUFFIX):
            path = shipped_path(folder, name, suffix)
            if file_hash(path) == sha256:
                return spec.replace(inner, str(path))
    return spec


def baseline_names() -> list[str]:
    """Return what may follow "baseline:": programs, then trained policies."""
    return [*BASELINES, *shipped_names(*TRAINED)]


def _baseline(spec: str) -> LoadedPolicy:
    name, (folder, suffix) = spec.removeprefix(PREFIX), TRAINED
    if name in shipped_names(*TRAINED):
        suffix = suffix if is_installed("torch") else SUFFIX
        return replace(load_policy(str(shipped_path(folder, name, suffix))), name=spec)
    if name not in BASELINES:
        raise InputError(f"There is no baseline '{name}'.{did_you_mean(name, baseline_names())}")
    policy = BASELINES[name]()
    task = CAVE if isinstance(policy, ReactivePolicy) else None
    return LoadedPolicy(policy, spec, None, "full", "multidiscrete", task, isinstance(policy, RandomPolicy))


def _load_file(path: Path, is_trusted: bool) -> FilePolicy:
    suffix = path.suffix.lower()
    if suffix == SUFFIX:
        return MlAgentsPolicy(path)
    if suffix in TORCHSCRIPT:
        if not is_trusted:
            raise InputError(
                f"{path} is called like TorchScript, which is a program: its operators can write files. If you trust "
                "whoever made it, add --trust. A Stable-Baselines3 zip or an ONNX file is read without running code."
            )
        return TorchScriptPolicy(path)
    try:
        return NetworkPolicy(path)
    except ExoticPolicyError:
        if not is_trusted:
            raise
        return TrustedPolicy(path)
