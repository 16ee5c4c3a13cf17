"""Which joint plays which role: guessed from names and shape, or told by a file.

For a quadruped the hind legs are the legs and the front legs are the arms. `chest` is the uppermost joint of
the spine; `root` exists only where the skeleton has a joint for the ground under the character.
"""

from .guessing import guess
from .names import side_and_rest
from .overrides import apply, load_overrides
from .posture import on_all_fours
from .vocabulary import ARM, LEG, ROLES, SIDES, opposite

__all__ = [
    "ARM",
    "LEG",
    "ROLES",
    "SIDES",
    "apply",
    "guess",
    "load_overrides",
    "on_all_fours",
    "opposite",
    "side_and_rest",
]
