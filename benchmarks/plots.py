"""Pictures of the records: cost against time, and time against frames."""

import re
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def plot_all(rows: list[dict], folder: Path) -> None:
    plot_scaling(rows, folder)
    try:
        plot_descent(folder)
    except ImportError as error:
        print(f"plots: cost against time left out, {error}")


def plot_descent(folder: Path) -> None:
    """Loss of descent and of LM against CPU time, one panel a scan."""
    import descent

    cases = descent.cases()
    figure, panels = plt.subplots(
        1, len(cases), figsize=(5.5 * len(cases), 4), squeeze=False, layout="constrained"
    )
    for panel, case in zip(panels[0], cases, strict=True):
        run = descent.run_descent(case)
        n_steps = len(run.loss_m) - 1
        at_s = run.cpu_s * np.arange(1, n_steps + 1) / n_steps
        shown = np.unique(np.geomspace(1, n_steps, 400).astype(int)) - 1
        times, losses = descent.curve(case)
        panel.plot(at_s[shown], run.loss_m[1:][shown], label=f"gradient descent, {n_steps} steps")
        panel.plot(times, losses, "o-", ms=3, label=f"planfit, {2 * len(losses) - 1} rounds")
        if run.stop_step < n_steps:
            panel.axvline(at_s[run.stop_step - 1], ls=":", c="0.5", label="the paper's stop test")
        panel.set(xscale="log", yscale="log", xlabel="CPU seconds, one thread", title=case.name)
        panel.set_ylabel("the paper's loss, m")
        panel.grid(alpha=0.3)
        panel.legend()
    figure.savefig(folder / "cost_against_time.png", dpi=130)
    plt.close(figure)


def plot_scaling(rows: list[dict], folder: Path) -> None:
    """Time and memory of a solve against frames."""
    found = {kind: {} for kind in ("s", "peak_gb")}
    for row in rows:
        name = re.fullmatch(r"solve_(\d+)k_(s|peak_gb)", row["name"])
        if name:
            found[name[2]][1000 * int(name[1])] = row["value"]
    if not found["s"]:
        return
    figure, panels = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for panel, (kind, label) in zip(
        panels, (("s", "solve, s"), ("peak_gb", "peak memory, GB")), strict=True
    ):
        frames = np.array(sorted(found[kind]))
        values = np.array([found[kind][n] for n in frames])
        panel.plot(frames, values, "o-", label="measured")
        panel.plot(frames, values[0] * frames / frames[0], ":", c="0.5", label="in proportion")
        panel.set(xscale="log", yscale="log", xlabel="frames", ylabel=label)
        panel.grid(alpha=0.3)
        panel.legend()
    figure.savefig(folder / "time_against_frames.png", dpi=130)
    plt.close(figure)
