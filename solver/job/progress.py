"""Progress of a job: to a terminal as a bar, to the job folder and a parent process as events."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

from ..streams import say
from .events import EventStream, clock
from .status import Heartbeat

# Shares of the whole run, for one bar over all stages (draft on two cores).
_SHARES = {"photos": 0.01, "compile": 0.05, "geometry": 0.05, "fit": 0.74, "asset": 0.09, "report": 0.06}
_FORM = "{desc:<34} {percentage:3.0f}% |{bar:30}| {elapsed}"


@contextmanager
def plain_bar() -> Iterator[Callable[[float, str], None]]:
    """A bar for what is no job, if stderr is a terminal; yields whom to tell the share done of what."""
    off = not sys.stderr.isatty()
    with tqdm(total=1000, file=sys.stderr, bar_format=_FORM, dynamic_ncols=True, disable=off) as bar:

        def told(done: float, text: str) -> None:
            bar.set_description_str(text, refresh=False)
            bar.n = int(1000 * done)
            bar.refresh()

        yield told


class Progress:
    """Tells whoever listens how far a job is.

    Args:
        events, heartbeat: the job's.
        bar: show a bar on stderr.
        shares: the stages in their order with their shares of the whole run; None: a reconstruction's.
    """

    EVENT_INTERVAL = 0.2

    def __init__(
        self, events: EventStream, heartbeat: Heartbeat, bar: bool, shares: dict[str, float] | None = None
    ):
        self._events, self._heartbeat = events, heartbeat
        self._shares = _SHARES if shares is None else shares
        self._bar = None
        if bar:
            form = _FORM + ", {postfix}"
            self._bar = tqdm(total=1000, file=sys.stderr, bar_format=form, dynamic_ncols=True)
        self._stage, self._stage_began = "", time.monotonic()
        self._last_event = 0.0
        self._text = ""

    def stage(self, name: str, text: str = "") -> None:
        self._stage, self._stage_began = name, time.monotonic()
        names = list(self._shares)
        self._events.emit("stage", name=name, index=names.index(name), count=len(names))
        state = {"fit": "running", "asset": "finishing", "report": "finishing"}.get(name, "preparing")
        self._heartbeat.update(state)
        self.fraction(0.0, text or name)

    def fraction(self, done: float, text: str = "") -> None:
        """How much of the stage is done."""
        self._text = text or self._text
        took = time.monotonic() - self._stage_began
        left = took / done * (1 - done) if done > 0.05 else None
        self._show(self._text, done, f"{clock(left)} left" if left is not None else "")
        self._emit(done, 0, 0, left)

    def fit(self, step: int, steps: int, done: float, left: float | None, psnr: float) -> None:
        """State of the optimisation: `left` seconds of it remain."""
        note = f"{clock(left)} left" if left is not None else "estimating"
        self._show(f"fit: step {step}, {psnr:.1f} dB", done, note)
        if self._emit(done, step, steps, left):
            self._events.emit("metric", name="psnr", value=round(psnr, 3), step=step)
        self._heartbeat.update("running", step, steps, left)

    def warning(self, text: str) -> None:
        """Something the person should know."""
        self._events.emit("warning", text=text)
        line = f"Warning: {text}."
        if self._bar is not None:
            self._bar.write(line, file=sys.stderr)
        else:
            say(line)

    def preview(self, file: str) -> None:
        self._events.emit("preview", file=file)

    def checkpoint(self, step: int) -> None:
        self._events.emit("checkpoint", step=step)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()

    def _emit(self, done: float, step: int, steps: int, left: float | None) -> bool:
        now = time.monotonic()
        if now - self._last_event < self.EVENT_INTERVAL and done < 1:
            return False
        self._last_event = now
        self._events.emit(
            "progress", stage=self._stage, text=self._text if self._stage != "fit" else "fit",
            step=step, steps=steps, fraction=round(done, 4), overall=round(self._overall(done), 4),
            seconds_left=None if left is None else round(left, 1),
        )  # fmt: skip
        return True

    def _overall(self, done: float) -> float:
        names = list(self._shares)
        before = sum(self._shares[name] for name in names[: names.index(self._stage)])
        return before + self._shares[self._stage] * min(max(done, 0.0), 1.0)

    def _show(self, text: str, done: float, note: str) -> None:
        if self._bar is not None:
            self._bar.set_description_str(text, refresh=False)
            self._bar.set_postfix_str(note, refresh=False)
            self._bar.n = int(1000 * self._overall(done))
            self._bar.update(0)
            self._bar.refresh() if done >= 1 else None
