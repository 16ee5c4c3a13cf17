"""The roles there are, and the words that names of joints use for them."""

from __future__ import annotations

LEG = ("up_leg", "leg", "foot", "toe")
ARM = ("shoulder", "arm", "forearm", "hand")
SIDES = ("left", "right")
ROLES: tuple[str, ...] = (
    *("root", "hips", "spine", "chest", "neck", "head"),
    *(f"{side}_{part}" for part in LEG + ARM for side in SIDES),
)


def _vocabulary(*entries: tuple[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    return {word: fits for words, fits in entries for word in words.split()}


# Words for parts, each with how well it fits a slot of a limb (3 is certain). Joints are named by the bone
# that they begin ("Calf") or by the articulation that they are ("Knee"); both stand for the same joint.
LEG_WORDS = _vocabulary(
    ("upleg upperleg thigh femur legupper legup topleg", {"up_leg": 3}),
    ("hip hips", {"up_leg": 1.5}),
    ("leg", {"leg": 2, "up_leg": 1}),
    ("lowerleg lowleg shin calf tibia knee leglower leglow stifle crus", {"leg": 3}),
    ("foot feet paw hoof", {"foot": 2.5, "toe": 1}),
    ("ankle hock tarsus", {"foot": 3}),
    ("toe toes toebase ball foretoe toeball", {"toe": 3}),
)
ARM_WORDS = _vocabulary(
    ("clavicle collar collarbone clav scapula", {"shoulder": 3}),
    ("shoulder", {"shoulder": 1.5, "arm": 1.6}),
    ("upperarm uparm humerus shldr bicep armupper armup", {"arm": 3}),
    ("arm", {"arm": 2.5}),
    ("forearm lowerarm lowarm elbow radius ulna armlower armlow farm", {"forearm": 3}),
    ("hand", {"hand": 2.5}),
    ("wrist carpus", {"hand": 2}),
)
FRONT = dict(zip(LEG, ("arm", "forearm", "hand", ""), strict=True))
_CENTER = {
    "hips": ("hips", "hip", "pelvis"),
    "spine": (
        *("spine", "chest", "thorax", "torso", "abdomen", "back", "lowerback", "upperback", "upperchest"),
        *("abdomenlower", "abdomenupper", "chestlower", "chestupper", "waist", "ribcage", "stomach", "belly"),
        *("spinebase", "spinemid", "spineshoulder", "spinelower", "spineupper", "spinechest", "spinenavel"),
    ),
    "neck": ("neck", "lowerneck", "upperneck", "necklower", "neckupper", "cervical"),
    "head": ("head", "skull"),
    "root": (
        *("root", "simulation", "trajectory", "reference", "ground", "world", "origin", "armature", "master"),
        *("motion", "global", "scene", "rootmotion", "skeleton", "null", "main"),
    ),
}
CENTER_WORDS = {word: part for part, words in _CENTER.items() for word in words}
SIDE_WORDS = {"l": "left", "left": "left", "lft": "left", "r": "right", "right": "right", "rgt": "right"}
FILLER = frozenset(
    "joint jnt jt bone bn b bip biped def org skin bind sk j jj node mixamorig character cc base valve "
    "valvebiped bend main rig skel".split()
)
# A joint with one of these words in its name hangs beside the chain that moves the body.
HELPERS = frozenset(
    "twist roll ik fk pole target ctrl control helper corrective tweak end nub tip site effector eff weapon "
    "prop socket attach dummy muscle skirt hair cloth aux offset top thumb index middle mid ring pinky "
    "little finger fingers eye eyes jaw tongue ear tail wing metatarsal metatarsals heel breast pectoral "
    "butt buttock mch vb cor share constraint locator camera cam goal hint knuckle palm big adj "
    "scale grp".split()
)
# Corners of a quadruped: front, and the three words for hind.
QUARTERS = {
    "f": ("fl", "fr"),
    "h": ("bl", "br"),
    "h2": ("hl", "hr"),
    "h3": ("rl", "rr"),
}

# Words that stand for parts without a role, which names glue to an "l" or "r" as well.
STUCK = frozenset("hipjoint fingers thumb toes buttock eye ear index heel".split())


def opposite(role: str) -> str:
    """The role on the other side of the body; a role of the middle is its own opposite."""
    for side, other in (SIDES, SIDES[::-1]):
        if role.startswith(side + "_"):
            return other + role[len(side) :]
    return role
