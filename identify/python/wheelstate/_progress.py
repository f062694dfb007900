"""How far long work is, on stderr."""

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import TypeAlias

Progress: TypeAlias = bool | Callable[[str, float], object] | None
"""Whether to show progress; None: if somebody is looking. A function is called with words and a share from 0 to 1."""

_WIDTH = 30
_WORDS = 32


class Bar:
    """A line on stderr that is written again and again, and taken away at the end."""

    def __init__(self, wanted: Progress) -> None:
        self._tell = wanted if callable(wanted) else None
        self._line = wanted if isinstance(wanted, bool) else self._tell is None and _somebody_looks()
        self._began = time.monotonic()
        self._shown = False

    def __enter__(self) -> Callable[[str, float], object] | None:
        if self._tell is not None:
            return self._tell
        return self._show if self._line else None

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._shown:
            sys.stderr.write("\r" + " " * (_WORDS + _WIDTH + 22) + "\r")
            sys.stderr.flush()

    def _show(self, what: str, share: float) -> None:
        done = "#" * round(_WIDTH * share)
        since = time.monotonic() - self._began
        left = f"{since * (1 / share - 1):5.0f} s left" if share > 0.02 else ""
        sys.stderr.write(f"\r{what[:_WORDS]:{_WORDS}} |{done:{_WIDTH}}| {100 * share:3.0f} % {left:12}")
        sys.stderr.flush()
        self._shown = True


def _somebody_looks() -> bool:
    """A terminal, or a notebook."""
    if sys.stderr and sys.stderr.isatty():
        return True
    python = sys.modules.get("IPython")
    return python is not None and hasattr(python.get_ipython(), "kernel")
