"""The state of N characters, apart from where they are in the data: one record each."""

from __future__ import annotations

import numpy as np

# Ground roots are (x, z, yaw): a root stands on the ground and turns about the vertical.
CHARACTER = np.dtype(
    [
        # The simulated object that the command drives.
        ("position", np.float32, 2),
        ("velocity", np.float32, 2),
        ("acceleration", np.float32, 2),
        ("yaw", np.float32),
        ("yaw_rate", np.float32),
        # The last command, and by how much it changed then.
        ("desired_velocity", np.float32, 2),
        ("desired_yaw", np.float32),
        ("velocity_change", np.float32),
        ("yaw_change", np.float32),
        ("required_tags", np.uint32),
        ("forbidden_tags", np.uint32),
        # Seconds until the next search is due, and until one may be forced again.
        ("until_search", np.float32),
        ("until_forced", np.float32),
        # The frame that the last jump left, and seconds until one may jump back there.
        ("left", np.int32),
        ("until_back", np.float32),
        # The ground root: as the data plays it, its inertialization offset, and as shown (their sum).
        ("data_root", np.float32, 3),
        ("root_offset", np.float32, 3),
        ("root_offset_rate", np.float32, 3),
        ("root", np.float32, 3),
        ("root_rate", np.float32, 3),
        ("searching", np.bool_),
        ("forced", np.bool_),
    ],
    align=True,
)
