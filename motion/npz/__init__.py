"""NumPy ``.npz`` files of motion: AMASS and other SMPL files, and plain ones; nothing is ever unpickled.

A file is read by the keys it has, in upper or lower case. T frames, J joints; lengths in the file's unit.

==================  ===================================================================  ============
what                keys                                                                 shape
==================  ===================================================================  ============
frame rate          fps, framerate, frame_rate, mocap_framerate, mocap_frame_rate,       number
                    mocap_fps; or frame_time, frametime, dt (seconds)
joint names         names, joint_names, bone_names; or joints, if strings                [J] strings
hierarchy           parents, parent, parent_indices, hierarchy, kintree_table; the       [J] integers
                    root's is -1 or itself
rest pose           offsets, rest_offsets, bone_offsets (in the parent's frame)          [J, 3]
                    or rest_positions, rest_joints, J, joints (places in the world)      [J, 3]
places in world     positions, world_positions, global_positions, joint_positions,       [T, J, 3]
                    xyz, joints
places in parents   local_positions, local_translations                                  [T, J, 3]
root's place        root_positions, root_position, root_pos, root_translation, trans,    [T, 3]
                    transl, translation
rotations in        rotations, local_rotations, quaternions, quats                       by format
parents             axis_angle, rotvec, poses (also as [T, 3 J])                         [T, J, 3]
                    euler, eulers, euler_angles (also as [T, 3 J])                       [T, J, 3]
                    rotmats, matrices, rotation_matrices                                 [T, J, 3, 3]
                    rot6d, rotations_6d                                                  [T, J, 6]
rotations in world  world_rotations, global_rotations                                    by format
format of           rotation_format: quaternion_wxyz (wxyz; default of [T, J, 4]),       string
rotations           quaternion_xyzw (xyzw), axis_angle, euler, matrix (default of
                    [T, J, 3, 3]), 6d (the matrix's first two columns, default of
                    [T, J, 6]), 6d_rows (its first two rows)
Euler angles        euler_order, rotation_order, order: zxy means R = Rz Rx Ry           string
unit of angles      angle_unit: radians (default) or degrees                             string
unit of lengths     unit (m, cm, mm, inch, foot) or unit_to_m (metres a unit); guessed   string or
                    from the size of the body where there is neither                     number
axes                up (default y), forward (default z, or -y where z is up): x to -z;   strings
                    handedness: right (default) or left
roles               roles (names) and role_joints; guessed where absent                  [R], [R]
end sites           end_site_joints and end_site_offsets                                 [E], [E, 3]
SMPL                poses [T, 66, 72, 156 or 165] without a hierarchy; or root_orient,   [T, 3 J]
                    pose_body, pose_hand, pose_jaw, pose_eye; or global_orient,
                    body_pose, left_hand_pose, right_hand_pose, jaw_pose, ...
==================  ===================================================================  ============

Needed are a frame rate and, SMPL apart, a hierarchy with either places in the world, or rotations with the
places of joints in their parents, in the world, or a rest pose and the root's place. Without rotations these
are recovered from the places (`directions`). What SMPL files lack, and what stands in for it, says `smpl`.

`write` makes files of the plain form that hold all that a clip does: reading one gives the same clip.
"""

from .reading import read
from .smpl import NOT_CLIPS, skeleton_file
from .writing import write

__all__ = ["NOT_CLIPS", "read", "skeleton_file", "write"]
