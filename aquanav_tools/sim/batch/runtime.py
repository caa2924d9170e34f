"""Warp, prepared for use: quiet, and compiling into the user's own cache folder."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warp._src import context

from aquanav_tools.errors import InputError
from aquanav_tools.first_compilation import say_compiling
from aquanav_tools.libraries import stderr_silenced

OPTIONS = {
    "enable_backward": False,
    "fast_math": False,
    "cpu_compiler_flags": (
        "-march=native -mllvm=-inline-threshold=60000 -mllvm=-inline-cold-callsite-threshold=3000"
        " -mllvm=-slp-recursion-max-depth=4"
    ),
}
"""For every module with kernels: nothing is differentiated, and float64 is meant as such.

The flags are Warp's own but for the first threshold, 9000 there: a function that is not inlined gets copies of all the
structures it is given, 7 kB for `kernels.hold`, which took a quarter of the time of `advance`.
"""
BOAT_OPTIONS = OPTIONS | {
    "cpu_compiler_flags": (
        "-march=native -ffp-contract=fast -mllvm=-inline-threshold=9000 -mllvm=-slp-recursion-max-depth=12"
    )
}
"""For boats: long sums of waves in vectors, which Warp's own flags compute half as fast."""


def find_device(name: str) -> Any:
    """Return Warp's device of a name: "cpu", "cuda" or "cuda:0".

    Compiled kernels are kept in the user's cache folder, or in that which WARP_CACHE_PATH names. Processes that compile
    the same kernels at once each write a folder of their own, and the first to be ready is taken.

    Raises:
        InputError: there is no such device; the message lists those at hand.
    """
    wp.config.log_level = wp.LOG_ERROR
    with stderr_silenced():  # a machine without a GPU would be told so on every start
        wp.init()
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError) as cause:
        known = ", ".join(str(device) for device in wp.get_devices())
        raise InputError(
            f"There is no device '{name}' for the batched simulation; at hand are: {known}. "
            "For a GPU, is its driver installed, and new enough for this build of warp-lang?"
        ) from cause


def launch_kernel(kernel: Any, *, device: Any, **arguments: Any) -> Any:
    """Do what `wp.launch` does, on a device or one of that name, and say so where the module is compiled first."""
    _tell_of_compiling(kernel.module, wp.get_device(device).is_cpu)
    return wp.launch(kernel, device=device, **arguments)


@cache
def _tell_of_compiling(module: Any, is_cpu: bool) -> None:
    if not is_compiled(module, is_cpu):
        say_compiling()


def is_compiled(module: Any, is_cpu: bool) -> bool:
    """Return whether the kernels of a module of Warp's, as they are now, lie compiled in the cache."""
    name = module.get_module_identifier(1 if is_cpu else None)  # it rests on the size of a block too
    return Path(wp.config.kernel_cache_dir, name).is_dir()


class _Recorded(threading.local):
    """What a thread records with Warp: nothing, to begin with."""

    _apic_capture: Any = None
    _apic_graph: Any = None


def _record_by_thread() -> None:
    """Let Warp's Python half keep for each thread by itself what it records, as its native half does.

    It has one place for all threads (1.19), so that arrays which others made meanwhile went into the recording too: two
    threads wrote to it at once, and now and then the process died of a double free, then or later.
    """
    recorded = _Recorded()

    def own(name: str) -> property:
        return property(lambda _: getattr(recorded, name), lambda _, value: setattr(recorded, name, value))

    for name in _Recorded.__annotations__:
        setattr(context.Runtime, name, own(name))


_record_by_thread()
_capturing = threading.Lock()
"""One sequence at a time: Warp promises threads nothing (NVIDIA/warp, issue 1714)."""


def sequence(launches: Sequence[Any], device: Any) -> Callable[[], None]:
    """Return a function that repeats launches, recorded with `wp.launch(..., record_cmd=True)`, one after the other.

    On the processor Warp itself goes through them: a launch for one vehicle takes half a microsecond so, and 2.4 by
    way of Python. What they read and write must live as long as the function.
    """
    if not device.is_cpu:
        return partial(_launch_all, launches)
    with _capturing, wp.ScopedCapture(device=device) as capture:
        _launch_all(launches)
    return partial(wp.capture_launch, capture.graph)


def run_slices(slices: Sequence[Callable[[], None]], threads: ThreadPoolExecutor | None) -> None:
    """Run the sequences of a batch's slices, each in a thread of its own: Warp lets go of Python. One needs none."""
    if threads is None:
        slices[0]()
    else:
        list(threads.map(_call, slices))


def _call(run: Callable[[], None]) -> None:
    run()


def _launch_all(launches: Sequence[Any]) -> None:
    for launch in launches:
        launch.launch()


def put_rows(array: Any, rows: npt.NDArray[np.integer], values: Any) -> None:
    """Write values into (n,) rows of an array on a device; rows that are wider keep what is beyond."""
    host = array.numpy()
    if host.ndim == 2:
        host[rows, : values.shape[1]] = values
    else:
        host[rows] = values
    if not array.device.is_cpu:  # where NumPy's array is not the same memory
        array.assign(host)
