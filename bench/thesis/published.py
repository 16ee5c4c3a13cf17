"""What the thesis found: facts from J. Segerstedt, Generating Character Animation for the Apex Game Engine
using Neural Networks, Chalmers 2021. Tables are the thesis's.

HOLDEN is said to have one hidden layer of 512, and its operations are counted so; its 122 MB of weights are
fifty sets of two hidden layers. Means of all files in Table A.4 are those of Table 5.2 but for AVA and AVA-M,
where they are 0.0311 and 0.0413; AVA's deviations in Table A.5 repeat its means. AVA's laps in Table A.3 have
a mean of 1.48 ms and a deviation of 0.033, not those of Table 5.1.
"""

from __future__ import annotations

SOURCE = "J. Segerstedt, Generating Character Animation for the Apex Game Engine using Neural Networks, 2021"
CONFIGURATIONS = ("HOLDEN", "HOLDEN-XL", "HOLDEN-XT", "AVA")
MASKED = "AVA-M"  # AVA, of the joints that HOLDEN has, too
LAPS = 19

# Table A.3: mean milliseconds a frame, lap by lap.
LAPS_MS = {
    "HOLDEN": (
        *(0.389, 0.394, 0.390, 0.362, 0.366, 0.388, 0.361, 0.353, 0.388, 0.357),
        *(0.367, 0.385, 0.338, 0.399, 0.355, 0.388, 0.391, 0.379, 0.386),
    ),
    "HOLDEN-XL": (
        *(0.496, 0.478, 0.528, 0.506, 0.490, 0.483, 0.483, 0.516, 0.475, 0.494),
        *(0.509, 0.491, 0.505, 0.486, 0.514, 0.483, 0.517, 0.507, 0.524),
    ),
    "HOLDEN-XT": (
        *(0.379, 0.373, 0.387, 0.415, 0.407, 0.350, 0.394, 0.363, 0.377, 0.371),
        *(0.402, 0.390, 0.363, 0.384, 0.360, 0.383, 0.394, 0.374, 0.383),
    ),
    "AVA": (
        *(1.474, 1.487, 1.496, 1.457, 1.451, 1.554, 1.488, 1.484, 1.488, 1.521),
        *(1.486, 1.462, 1.471, 1.471, 1.456, 1.450, 1.514, 1.490, 1.397),
    ),
}
# Table 5.1: mean and deviation of the laps, ms.
FRAME_MS = {
    "HOLDEN": (0.376, 0.0173),
    "HOLDEN-XL": (0.499, 0.0161),
    "HOLDEN-XT": (0.382, 0.0167),
    "AVA": (1.55, 0.0430),
}
# Table 5.2: mean and deviation over 80 files of the relative error.
ACCURACY = {
    "HOLDEN": (0.0439, 0.00954),
    "HOLDEN-XL": (0.0448, 0.00980),
    "HOLDEN-XT": (0.0446, 0.00981),
    "AVA": (0.0148, 0.00283),
    "AVA-M": (0.0258, 0.00483),
}
# Of Table A.4: least, quartiles and greatest of the files.
ACCURACY_BOX = {
    "HOLDEN": (0.0271, 0.0382, 0.0443, 0.0492, 0.0781),
    "HOLDEN-XL": (0.0296, 0.0390, 0.0444, 0.0490, 0.0821),
    "HOLDEN-XT": (0.0272, 0.0394, 0.0453, 0.0493, 0.0798),
    "AVA": (0.0235, 0.0287, 0.0303, 0.0323, 0.0511),
    "AVA-M": (0.0303, 0.0383, 0.0405, 0.0433, 0.0623),
}
# Table 6.1, and the line of its Figure 6.1: milliseconds by operations.
OPERATIONS = {"HOLDEN": 335_501, "HOLDEN-XL": 598_157, "HOLDEN-XT": 335_501, "AVA": 1_566_701}
LINE = (9.6e-7, 0.018)
# Table 5.3, seconds. AVA had every fourth frame only.
PIPELINE_S: dict[str, dict[str, float]] = {
    "patches": {"HOLDEN": 28 * 60},
    "vectors": {"HOLDEN": 90 * 60, "AVA": 55 * 60},
    "training": {"HOLDEN": 43 * 3600, "HOLDEN-XL": 47 * 3600, "HOLDEN-XT": 91 * 3600, "AVA": 31 * 3600},
}
# Table 5.4, MB.
SIZES_MB: dict[str, dict[str, float]] = {
    "height fields": {"HOLDEN": 134},
    "patches": {"HOLDEN": 606},
    "motion": {"HOLDEN": 848, "AVA": 7620},
    "labels": {"HOLDEN": 7.04 + 56.9},
    "vectors": {"HOLDEN": 7120, "AVA": 10400},
    "weights": {"HOLDEN": 122, "HOLDEN-XL": 176, "HOLDEN-XT": 122, "AVA": 374},
}
# Of Tables A.6 to A.9: mean squared error of all outputs after so many epochs.
_FIRST = (*range(0, 2000, 100), 1990)
TRAINING = {
    "HOLDEN": dict(
        zip(
            _FIRST,
            (
                *(0.442, 0.300, 0.286, 0.280, 0.275, 0.272, 0.269, 0.267, 0.265, 0.265, 0.262),
                *(0.260, 0.260, 0.259, 0.257, 0.258, 0.256, 0.256, 0.255, 0.253, 0.254),
            ),
            strict=True,
        )
    ),
    "HOLDEN-XL": dict(
        zip(
            _FIRST,
            (
                *(0.474, 0.301, 0.285, 0.278, 0.273, 0.269, 0.265, 0.264, 0.261, 0.259, 0.258),
                *(0.256, 0.255, 0.254, 0.253, 0.253, 0.251, 0.251, 0.249, 0.249, 0.248),
            ),
            strict=True,
        )
    ),
    "HOLDEN-XT": dict(
        zip(
            (*range(2000, 4000, 200), 3990),
            (0.253, 0.252, 0.251, 0.250, 0.250, 0.248, 0.247, 0.247, 0.247, 0.246, 0.245),
            strict=True,
        )
    ),
    "AVA": dict(
        zip(
            _FIRST,
            (
                *(0.782, 0.539, 0.527, 0.547, 0.542, 0.484, 0.540, 0.472, 0.464, 0.528, 0.509),
                *(0.475, 0.455, 0.469, 0.517, 0.465, 0.463, 0.464, 0.538, 0.443, 0.461),
            ),
            strict=True,
        )
    ),
}
