"""Showing how far long work has come."""

from __future__ import annotations

import sys
import time

from aquanav_tools.types import Progress


def show_progress(what: str) -> Progress:
    """Return a callback that counts on standard error: on one line of a terminal, in tenths where it is recorded."""
    began = time.monotonic()
    is_terminal = sys.stderr.isatty()

    def show(done: int, total: int) -> None:
        is_last = done >= total
        if not is_terminal and not is_last and done * 10 // total == (done - 1) * 10 // total:
            return
        elapsed = time.monotonic() - began
        text = f"{done} of {total} {what}, " + (
            f"{elapsed:.0f} s" if is_last else f"about {elapsed / max(done, 1) * (total - done):.0f} s left"
        )
        print(f"\r{text:<60}" if is_terminal else text, end="\n" if is_last or not is_terminal else "", file=sys.stderr)
        sys.stderr.flush()

    return show
