"""The columns of a comparison's tables: what they are, by groups, and which tell the most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

COMMON = 0.5  # of the systems: what more of them are is nothing to be marked


@dataclass(frozen=True)
class Column:
    """A number of systems: its name in the tables, title and unit, digits after the point, what it is.

    better : which numbers are: the "least", the "most", those "near one"; "" where none is.
    """

    name: str
    title: str
    unit: str
    digits: int
    about: str
    better: str = "least"

    @property
    def telling(self) -> bool:
        """Whether the page shows it at once."""
        return self.name in TELLING

    @property
    def heading(self) -> str:
        return f"{self.title} {self.unit}".strip()

    def best(self, values: pd.Series) -> NDArray[np.bool_]:
        """Which of the values are shown as the best ones; none where it tells little, since many are."""
        shown = values.astype(float).round(self.digits)
        far = {"least": shown, "most": -shown, "near one": (shown - 1).abs()}.get(self.better)
        best = np.zeros(len(values), bool) if far is None else np.array(far == far.min())
        return best if best.mean() <= COMMON else np.zeros_like(best)


GROUPS: dict[str, tuple[Column, ...]] = {
    "memory": (
        Column("memory_mb", "memory", "MB", 2, "all that the system holds, 10^6 bytes"),
        Column("of_lmm_memory", "memory", "× LMM", 2, "the same as a multiple of what lmm-PSD holds", ""),
    ),
    "cost": (
        Column(
            "frame_us", "frame", "µs", 1, "median of a whole frame, one character, one pinned thread, warm"
        ),
        Column("frame_mean_us", "mean", "µs", 1, "mean of a whole frame, its share of the searches included"),
        Column("of_lmm_mean", "mean", "× LMM", 2, "the mean as a multiple of lmm-PSD's", ""),
        Column("frame_p99_us", "p99", "µs", 0, "99th percentile of a whole frame"),
        Column(
            "frame_spread_us",
            "spread",
            "µs",
            1,
            "how far the means of three runs over the same frames are apart",
        ),
        Column("search_us", "search", "µs", 1, "median of the projection over the frames that searched"),
        Column(
            "frame_bytes",
            "allocated",
            "B",
            0,
            "bytes that a frame without a search allocates, and frees again: arrays made anew, handles of "
            "those that kernels are given, objects of Python",
            "",
        ),
        Column("search_bytes", "with search", "B", 0, "the same of a frame with a search", ""),
    ),
    "motion": (
        Column("skate_cm_s", "skate", "cm/s", 2, "mean of v (2 - 2^(h/H)), H = 2.5 cm, over frames and feet"),
        Column(
            "sink_cm",
            "sink",
            "cm",
            2,
            "mean depth of the deepest heel or toe in the ground, the shortest way out",
        ),
        Column(
            "hover_cm",
            "hover",
            "cm",
            2,
            "how high the lower of heel and toe of a foot in contact is over it, mean",
        ),
        Column("pop_cm", "max pop", "cm", 2, "largest jump of a joint at any transition beyond its velocity"),
        Column(
            "skate_ratio", "skating", "", 3, "share of frames with a foot below 5 cm and faster than 0.5 m/s"
        ),
        Column(
            "glide_share",
            "gliding",
            "",
            3,
            "share of frames that travel without a foot going back under the root",
        ),
        Column(
            "airborne_share",
            "airborne",
            "",
            3,
            "share of frames with every foot over 5 cm above its rest: flight",
            "",
        ),
        Column(
            "sink_p99_cm", "sink p99", "", 1, "99th percentile of the depth of the deepest heel or toe, cm"
        ),
        Column("jerk_m_s3", "jerk", "m/s³", 0, "mean norm of the third difference of joint positions", ""),
        Column("ordinary_pop_cm", "no pop", "cm", 2, "jumps where there is no transition, 99th percentile"),
        Column("transitions_per_s", "trans/s", "", 2, "transitions a second", ""),
    ),
    "obedience": (
        Column("path_cm", "path", "cm", 1, "mean distance from the commanded path, on courses that have one"),
        Column(
            "heading_deg", "heading", "°", 1, "mean difference between the facing and the commanded facing"
        ),
        Column("speed_response_s", "speed", "s", 2, "time from a step in the commanded speed to 90 % of it"),
        Column("path_p95_cm", "path p95", "", 1, "95th percentile of the distance from the path, cm"),
        Column("path_max_cm", "path max", "", 1, "the largest distance from the path, cm"),
        Column(
            "heading_response_s", "turn", "s", 2, "time from a step in the commanded facing to 90 % of it"
        ),
        Column(
            "unanswered_share",
            "unanswered",
            "",
            2,
            "share of those steps that were not answered before the next",
        ),
        Column("speed_ratio", "speed ratio", "", 2, "metres walked over metres commanded", "near one"),
        Column("stall_s", "no step", "s", 2, "longest time for which who was asked to go did not step"),
    ),
    "poses": (
        Column(
            "pose_cm",
            "pose error",
            "cm",
            2,
            "joints of poses decoded of true frames, from the data's, root-aligned",
        ),
        Column("pose_held_cm", "held-out", "cm", 2, "the pose error of clips that no model was trained on"),
        Column("real_cm", "real pose", "cm", 2, "joints from the nearest pose of the data, root-aligned"),
        Column(
            "mm_near_cm", "near mm", "cm", 2, "to what mm-exact shows within half a second, asked the same"
        ),
        Column("pose_p99_cm", "p99", "", 2, "99th percentile of the pose error, cm"),
        Column("pose_worst_cm", "worst", "", 2, "the pose error of the worst joint, its mean, cm"),
        Column("pose_deg", "°", "", 2, "mean angle between the joints' own rotations, decoded and true"),
        Column("pose_cm_s", "cm/s", "", 1, "mean difference of the joints' velocities, decoded and true"),
        Column(
            "mm_cm", "from mm", "cm", 1, "to what mm-exact shows at the same frame: being out of step counts"
        ),
    ),
}
# Those that a page shows at once; the others are behind a switch.
TELLING = (
    "memory_mb",
    "of_lmm_memory",
    "frame_us",
    "frame_mean_us",
    "of_lmm_mean",
    "frame_p99_us",
    "frame_bytes",
    "skate_cm_s",
    "sink_cm",
    "hover_cm",
    "pop_cm",
    "path_cm",
    "heading_deg",
    "speed_response_s",
    "pose_cm",
    "pose_held_cm",
    "real_cm",
    "mm_near_cm",
)
COLUMNS = tuple(column for columns in GROUPS.values() for column in columns)
# Those that the terminal shows.
BRIEF = (
    "memory_mb",
    "of_lmm_memory",
    "frame_us",
    "frame_mean_us",
    "of_lmm_mean",
    "frame_p99_us",
    "search_us",
    "frame_bytes",
    "skate_cm_s",
    "glide_share",
    "airborne_share",
    "sink_cm",
    "sink_p99_cm",
    "hover_cm",
    "path_cm",
    "heading_deg",
    "speed_response_s",
    "heading_response_s",
    "jerk_m_s3",
    "pop_cm",
    "pose_cm",
    "pose_held_cm",
    "real_cm",
    "mm_near_cm",
    "transitions_per_s",
    "speed_ratio",
)
