"""How far long work is, on stderr."""

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, TypeAlias

Progress: TypeAlias = bool | Callable[[str, float], object] | None
"""Whether to show progress; None: if somebody is looking. A function is called with words and a share from 0 to 1."""

_WIDTH = 30
_WORDS = 40
# Work that takes no longer than this shows nothing, s.
_PATIENCE = 0.7


class Bar:
    """A line that is written again and again, and taken away at the end: on stderr, or below the cell of a notebook."""

    def __init__(self, wanted: Progress) -> None:
        self._tell = wanted if callable(wanted) else None
        self._line = wanted if isinstance(wanted, bool) else self._tell is None and (_terminal() or _notebook())
        self._began = time.monotonic()
        self._shown = False
        self._below_cell: Any = None

    def __enter__(self) -> Callable[[str, float], object] | None:
        if self._tell is not None:
            return self._tell
        return self._show if self._line else None

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._shown:
            self._write("")

    def _show(self, what: str, share: float) -> None:
        since = time.monotonic() - self._began
        if since > _PATIENCE:
            done = "#" * round(_WIDTH * share)
            left = f"{since * (1 / share - 1):5.0f} s left" if share > 0.02 else ""
            self._write(f"{what[:_WORDS]:{_WORDS}} |{done:{_WIDTH}}| {100 * share:3.0f} % {left:12}")

    def _write(self, line: str) -> None:
        if not _notebook():
            sys.stderr.write(f"\r{line:{_WORDS + _WIDTH + 21}}" + ("" if line else "\r"))
            sys.stderr.flush()
        elif self._shown:
            self._below_cell.update({"text/plain": line}, raw=True)
        else:
            import IPython.display

            display: Any = IPython.display.display
            self._below_cell = display({"text/plain": line}, raw=True, display_id=True)
        self._shown = True


def _terminal() -> bool:
    return bool(sys.stderr and sys.stderr.isatty())


def _notebook() -> bool:
    python = sys.modules.get("IPython")
    return python is not None and hasattr(python.get_ipython(), "kernel")
