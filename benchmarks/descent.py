"""The paper's gradient descent against planfit's Levenberg-Marquardt, on the paper's own cost.

Same points, association, cost and start; CPU time, because other load on the machine would lengthen
a descent of minutes and not a solve of milliseconds. Descents are long, so they are kept beside the matches
(`inputs.CACHE`) and run again only with `--fresh`. Both solvers run on one thread here: descent is
slower on two when the machine is shared, and below 100,000 points so is planfit's pass.
"""

import hashlib
import time
from dataclasses import dataclass

import numpy as np
from inputs import CACHE, Case, position_rms_m, real_case, synthetic_case
from records import Record, median_times

from planfit.adjust.paper.descent import DescentSchedule, PaperWeights, descend
from planfit.adjust.paper.preset import paper_terms
from planfit.lsq.solver import Solution, SolverOptions, solve

TOLERANCE_M = 1e-5
LONGEST = DescentSchedule(tolerance=0.0, record_every_steps=1, dtype="float32")
"""The whole schedule without a stop test: where the test would have stopped is read off the losses."""


@dataclass(frozen=True)
class Run:
    """One whole descent."""

    loss_m: np.ndarray  # (25001,) before each step
    elapsed_s: np.ndarray  # (25001,)
    cpu_s: float  # of the whole
    plan_from_cams: np.ndarray  # (n, 4, 4) at the end

    @property
    def stop_step(self) -> int:
        """Step at which the paper's test, made at the late learning rate only, is first met; or the last."""
        late = LONGEST.drop_after_steps
        small = np.flatnonzero(np.abs(np.diff(self.loss_m[late:])) < TOLERANCE_M)
        return late + int(small[0]) + 1 if len(small) else len(self.loss_m) - 1


def cases() -> list[Case]:
    return [case for case in (real_case(), synthetic_case()) if case is not None]


def run_descent(case: Case, fresh: bool = False) -> Run:
    """The whole descent, from the cache where it is there."""
    key = hashlib.sha256(case.initial_plan_from_cams.tobytes() + repr(LONGEST).encode())
    for part in (case.matches.points_a, case.structure.floor.points_cam, case.association.face_idx):
        key.update(np.ascontiguousarray(part).tobytes())
    path = CACHE / f"descent-{key.hexdigest()[:16]}.npz"
    if fresh or not path.exists():
        import torch

        torch.set_num_threads(1)
        begin = time.process_time()
        found = descend(*case.paper_inputs, case.initial_plan_from_cams, PaperWeights(), LONGEST)
        cpu_s = time.process_time() - begin
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(
            path,
            loss_m=found.loss_m,
            elapsed_s=found.elapsed_s,
            cpu_s=cpu_s,
            plan_from_cams=found.target_from_cams,
        )
    with np.load(path) as kept:
        return Run(kept["loss_m"], kept["elapsed_s"], float(kept["cpu_s"]), kept["plan_from_cams"])


def solver_options(n_rounds: int) -> SolverOptions:
    return SolverOptions(n_rounds, cost_tolerance=1e-9)


def paper_solution(case: Case, n_rounds: int) -> tuple[float, np.ndarray]:
    """Loss (m) and poses after a number of rounds of reweighting."""
    terms = paper_terms(*case.paper_inputs, PaperWeights())
    solution = solve(terms, case.initial_plan_from_cams, solver_options(n_rounds))
    loss_m = sum(cost.after for cost in solution.cost_by_term.values())
    return loss_m, solution.target_from_cams


def rounds_to_reach(case: Case, loss_m: float, most: int = 200) -> int:
    """Fewest rounds that end no higher than a loss; raises where none does."""
    for n_rounds in range(1, most + 1):
        if paper_solution(case, n_rounds)[0] <= loss_m:
            return n_rounds
    raise RuntimeError(f"{case.name}: {most} rounds did not reach {loss_m:.6g} m")


def records(fresh: bool = False) -> list[Record]:
    """Ratio of times to the same loss, where the test stops the descent and at its full length."""
    made = []
    for case in cases():
        run = run_descent(case, fresh)
        n_steps = len(run.loss_m) - 1
        for label, step in (("", run.stop_step), ("_full_schedule", n_steps)):
            if label and step == run.stop_step:
                continue
            n_rounds = rounds_to_reach(case, float(run.loss_m[step]))
            wall_s, cpu_s = median_times(lambda c=case, n=n_rounds: paper_solution(c, n), 7)
            loss_m, poses = paper_solution(case, n_rounds)
            descent_cpu_s = run.cpu_s * step / n_steps
            conditions = (
                f"{case.size}; CPU time, one thread each (both share the machine with others; wall "
                f"ratio {wall_s / run.elapsed_s[step]:.3g}); descent: {step} steps, "
                f"{descent_cpu_s:.1f} s CPU, {run.elapsed_s[step]:.1f} s wall, loss "
                f"{run.loss_m[0]:.4f} -> {run.loss_m[step]:.4f} m, float32; LM: {n_rounds} rounds, "
                f"{cpu_s:.3f} s CPU, {wall_s:.3f} s wall, loss {loss_m:.4f} m, position RMS "
                f"{position_rms_m(case, case.initial_plan_from_cams):.3f} -> "
                f"{position_rms_m(case, poses):.3f} m"
            )
            name = f"lm_over_sgd_time{label}, {case.name}"
            made.append(Record(name, cpu_s / descent_cpu_s, "1", conditions))
        made.append(_own_stop(case, run))
        made.append(
            Record(
                f"sgd_step, {case.name}",
                1e3 * run.cpu_s / n_steps,
                "ms",
                f"{case.size}; CPU time, one thread, float32; end of schedule: position RMS "
                f"{position_rms_m(case, run.plan_from_cams):.3f} m",
            )
        )
    return made


def _own_stop(case: Case, run: Run) -> Record:
    """LM run on to its own stop, beyond any loss that descent reaches, over the whole descent."""
    terms = paper_terms(*case.paper_inputs, PaperWeights())
    options = SolverOptions(200)

    def whole() -> Solution:
        return solve(terms, case.initial_plan_from_cams, options)

    _, cpu_s = median_times(whole, 3)
    solution = whole()
    loss_m = sum(cost.after for cost in solution.cost_by_term.values())
    conditions = (
        f"{case.size}; LM to a relative decrease below {options.cost_tolerance:g}: "
        f"{solution.iterations} rounds ({solution.stop.name}), {cpu_s:.2f} s CPU, loss {loss_m:.4f} m, "
        f"position RMS {position_rms_m(case, solution.target_from_cams):.3f} m; descent: whole "
        f"schedule, {run.cpu_s:.1f} s CPU, loss {run.loss_m[-1]:.4f} m"
    )
    return Record(f"lm_own_stop_over_sgd_time, {case.name}", cpu_s / run.cpu_s, "1", conditions)


def curve(case: Case, most: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """CPU seconds (k,) and loss (k,) m of LM, by the number of rounds."""
    times, losses = [], []
    for n_rounds in range(1, most + 1, 2):
        times.append(median_times(lambda n=n_rounds: paper_solution(case, n), 3)[1])
        losses.append(paper_solution(case, n_rounds)[0])
    return np.array(times), np.array(losses)
