"""Rotations and forward kinematics in torch, on matrices, level by level of the hierarchy."""

from __future__ import annotations

import torch
from torch import Tensor

from motion.skeleton import Skeleton


def orthonormal(xy: Tensor) -> Tensor:
    """Matrices [..., 3, 3] of two columns [..., 3, 2] each, by Gram-Schmidt (as `lmm.layout.rotations`)."""
    x = torch.nn.functional.normalize(xy[..., 0], dim=-1)
    z = torch.nn.functional.normalize(torch.cross(x, xy[..., 1], dim=-1), dim=-1)
    return torch.stack([x, torch.cross(z, x, dim=-1), z], dim=-1)


class ForwardKinematics:
    """World transforms and velocities of all joints in the root's space, the root itself at rest.

    One gather and a few products a level of the hierarchy; the same numbers as
    `motion.kinematics.forward_velocities`.
    """

    def __init__(self, skeleton: Skeleton, device: torch.device | str = "cpu") -> None:
        # Joints but the root, by level; parents as places in the concatenation of all levels before.
        self._levels: list[tuple[Tensor, Tensor]] = []
        order = [0]
        for joints in skeleton.levels()[1:]:
            places = [order.index(int(p)) for p in skeleton.parents[joints]]
            self._levels.append(
                (torch.as_tensor(joints - 1, device=device), torch.tensor(places, device=device))
            )
            order += joints.tolist()
        back = [order.index(j) for j in range(len(skeleton))]
        self._back = torch.tensor(back[1:], device=device)

    def __call__(
        self, positions: Tensor, rotations: Tensor, velocities: Tensor, angular: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Of local positions [B, J-1, 3], rotations [B, J-1, 3, 3], velocities and angular velocities
        [B, J-1, 3] of all joints but the root: the same in the root's space."""
        count = positions.shape[0]
        zero = positions.new_zeros(count, 1, 3)
        x, v, w = zero, zero, zero
        r = torch.eye(3, dtype=positions.dtype, device=positions.device).expand(count, 1, 3, 3)
        for joints, parents in self._levels:
            turn, rate = r[:, parents], w[:, parents]
            arm = _turned(turn, positions[:, joints])
            x = torch.cat([x, x[:, parents] + arm], dim=1)
            v = torch.cat(
                [v, v[:, parents] + _turned(turn, velocities[:, joints]) + torch.cross(rate, arm, dim=-1)],
                dim=1,
            )
            w = torch.cat([w, rate + _turned(turn, angular[:, joints])], dim=1)
            r = torch.cat([r, turn @ rotations[:, joints]], dim=1)
        back = self._back
        return x[:, back], r[:, back], v[:, back], w[:, back]


def _turned(matrices: Tensor, vectors: Tensor) -> Tensor:
    return (matrices @ vectors[..., None])[..., 0]
