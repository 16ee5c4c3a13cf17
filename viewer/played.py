"""What a system does, or did, as something to show: a character of a session, or of a recorded run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mm.database import Database
from mm.description import Description, anatomy_of
from motion import kinematics
from motion.errors import UserError

from .body import Body, body, bones
from .shows import Worn
from .timeline import Timeline

Array = NDArray[np.floating]


class Played:
    """A `viewer.shows.Show` of what a timeline remembers, at the timeline's own times.

    seconds : None, since it may go on.
    """

    count = 1
    skin: Worn | None = None
    seconds: float | None = None

    def __init__(self, name: str, timeline: Timeline, shape: Body) -> None:
        self.name, self.timeline, self.body = name, timeline, shape
        self.skeleton, self.fps = timeline.skeleton, timeline.fps

    def pose(self, time: float) -> tuple[Array, Array]:
        """See `viewer.shows.Show`."""
        positions, rotations = self.timeline.pose(time)
        return kinematics.forward(self.skeleton, positions[None], rotations[None])


def shape_of(description: Description, data: object = None) -> Body:
    """What characters of a system look like: by its description, or else by how its database moves; of bare
    bones where roles tell too little."""
    try:
        if description.anatomy is not None:
            return body(description.anatomy)
        if isinstance(data, Database):
            return body(anatomy_of(data))
    except UserError:
        pass
    return bones(description.skeleton)
