"""Jobs by processes of this machine, as many as its memory holds."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from planfit.batch.inputs import Stamp
from planfit.batch.ledger import End, State
from planfit.batch.memory import GB, Expectation, free_bytes
from planfit.batch.process import MAX_TRIES, Errand, Launcher, Running

_POLL_S = 0.05
_SETTLING_S = 30.0
"""For so long a process takes up memory: what it was given is still counted as taken in what is free."""


@dataclass(frozen=True)
class Task:
    """A job to be done, and what is known of it."""

    errand: Errand
    scan: Stamp | None
    """Of its scan; None where that cannot be looked at, and it will be refused."""

    @property
    def measured_bytes(self) -> int | None:
        """Its peak when it was done another time, with whatever options."""
        state = self.errand.ledger.state(self.errand.job.name)
        return state.peak_bytes if state is not None and state.end is End.DONE else None


@dataclass
class _Try:
    task: Task
    measured: int | None
    number: int = 1
    need: int = 0
    begin: float = 0.0
    running: Running | None = None


@dataclass
class LocalPool:
    """Runs tasks side by side."""

    launcher: Launcher
    workers: int
    """Processes at a time."""
    allowed_bytes: int | None
    """All of them together; None: nobody knows, and only their number counts."""
    on_start: Callable[[Task, int], None] = lambda _task, _number: None
    """Told of each try, 1 or 2."""
    free: Callable[[], int | None] = free_bytes
    """Memory that can be had now."""
    _expected: Expectation = field(default_factory=Expectation, init=False)

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, State]]:
        """Each task with how it ended, as they end. Leaving the loop stops those that go on."""
        waiting = [_Try(task, task.measured_bytes) for task in tasks]
        going: list[_Try] = []
        try:
            while waiting or going:
                for one in [one for one in waiting if self._never_fits(one)]:
                    waiting.remove(one)
                    yield one.task, self._refusal(one)
                while (one := self._next(waiting, going)) is not None:
                    waiting.remove(one)
                    self.on_start(one.task, one.number)
                    one.begin = time.monotonic()
                    one.running = self.launcher.start(one.task.errand, one.number)
                    going.append(one)
                ended = [(one, state) for one in going if (state := _poll(one)) is not None]
                for one, state in ended:
                    going.remove(one)
                    self._expected.learn(one.task.scan, state.peak_bytes)
                    if state.end is End.CRASHED and one.number < MAX_TRIES:
                        waiting.append(_Try(one.task, one.measured, one.number + 1))
                    else:
                        yield one.task, state
                if not ended:
                    time.sleep(_POLL_S)
        finally:
            for one in going:
                if one.running is not None:
                    one.running.close()  # all at once, then wait for each
            for one in going:
                if one.running is not None:
                    one.running.stop()

    def _need(self, one: _Try) -> int:
        task = one.task
        need = self._expected.of(task.scan, task.errand.job.memory_gb, one.measured)
        if one.number > 1 and task.errand.job.memory_gb is None:
            need *= 2  # perhaps the system ended it, for want of memory
            need = need if self.allowed_bytes is None else min(need, self.allowed_bytes)
        return need

    def _never_fits(self, one: _Try) -> bool:
        return self.allowed_bytes is not None and self._need(one) > self.allowed_bytes

    def _refusal(self, one: _Try) -> State:
        assert self.allowed_bytes is not None
        need, allowed = (value / GB for value in (self._need(one), self.allowed_bytes))
        state = State(
            End.REFUSED,
            reason=f"not started: it is expected to need {need:.1f} GB of memory, and {allowed:.1f} GB are "
            "allowed; give more with --memory-gb, or say what it needs in the column memory-gb",
        )
        errand = one.task.errand
        errand.ledger.keep_state(errand.job.name, state)
        return state

    def _next(self, waiting: Sequence[_Try], going: Sequence[_Try]) -> _Try | None:
        """The first that fits beside those that go on. A second try waits for the first ones."""
        if len(going) >= self.workers:
            return None
        taken = sum(one.need for one in going)
        now = time.monotonic()
        # What young processes will take is not yet missing in what is free.
        coming = sum(one.need for one in going if now - one.begin < _SETTLING_S)
        free = self.free()
        for one in waiting:
            need = self._need(one)
            is_allowed = self.allowed_bytes is None or taken + need <= self.allowed_bytes
            if is_allowed and (free is None or coming + need <= free):
                one.need = need
                return one
        return None


def _poll(one: _Try) -> State | None:
    assert one.running is not None
    return one.running.poll()
