"""glTF 2.0 files, ``.gltf`` and ``.glb``: animations and skins, read and written.

A file's nodes become a skeleton, each of its animations a clip. The format is right-handed, Y up, +Z forward
and in metres, as ours is. Zero rotations are the pose that the skin was bound in, or else that of the nodes
as they stand in the file (Khronos Group, "glTF 2.0 Specification", 2.0.1).
"""

from .clips import animations, read, read_all
from .skins import Skin, skin
from .writing import write

__all__ = ["Skin", "animations", "read", "read_all", "skin", "write"]
