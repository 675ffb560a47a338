"""The numbers that the paper printed (Tables I to III): MME, MPV, MOM, NND, NSD; lower is better.

"Floorplan-Aware Camera Poses Refinement", IROS 2022. MPV and MOM in cm^2, NND and NSD in cm; None: not given.
"""

Row = tuple[float | None, float | None, float | None, float | None, float | None]
METRICS = ("mme", "mpv", "mom", "nnd", "nsd")

PUBLISHED: dict[str, dict[str, Row]] = {
    "redwood-like": {
        "none": (-3.81, 18.68, 33.07, 9.43, 8.37),
        "geometric": (-3.84, 17.98, 32.63, 9.09, 8.49),
        "geometric + floor": (-3.99, 14.72, 29.23, 8.48, 8.97),
        "geometric + walls": (-3.94, 15.52, 29.61, 8.62, 6.53),
        "all": (-4.02, 14.46, 28.94, 8.38, 6.31),
        "nearest point": (-3.93, 16.88, 31.04, None, 4.84),
        "iterative nearest wall": (-3.96, 15.39, 30.91, None, 6.31),
        "reprojection": (-3.91, 16.94, 30.78, None, 6.96),
        "ray distance": (-3.88, 17.86, 31.07, None, 8.11),
        "bounded, 3D points": (-3.89, 17.45, 29.26, None, 7.16),
        "bounded, reprojection": (-3.88, 17.73, 30.55, None, 7.45),
    },
    "phone-like": {
        "none": (-3.53, 30.01, 81.55, None, 28.23),
        "geometric": (-3.61, 25.51, 65.19, None, 28.17),
        "geometric + floor": (-3.62, 25.01, 61.62, None, 28.49),
        "geometric + walls": (-3.61, 25.13, 61.84, None, 25.14),
        "all": (-3.63, 24.86, 59.08, None, 25.10),
        "nearest point": (-3.59, 25.45, 63.81, None, 16.60),
        "iterative nearest wall": (-3.60, 25.50, 63.88, None, 24.18),
        "reprojection": (-3.56, 27.21, 64.79, None, 25.99),
        "ray distance": (-3.54, 29.64, 78.78, None, 28.22),
        "bounded, 3D points": (-3.62, 25.39, 63.36, None, 25.92),
        "bounded, reprojection": (-3.58, 27.12, 64.35, None, 26.40),
    },
}
"""By set and variant. "geometric + walls" is also the fixed nearest wall of Table II, "all" the 3D point
error of Table III."""

MS_A_STEP = {
    "nearest point": 66.52,
    "iterative nearest wall": 70.47,
    "geometric + walls": 6.90,
}
"""Table II, Redwood: time a step of the paper's solver."""
