"""The optimiser: lazy Adam on groups of parameters, each with its own rate.

torch's own would do, but takes two seconds to import its compiler, and goes over all of every grid.
"""

import torch
from torch import Tensor

from ..kernels.adam import Moments, Rates, adam_step, mean_root_square


class Adam:
    """Adam whose gradients are cleared by the step that used them.

    Args:
        groups: of 'params', a list of tensors, and 'base', the group's rate; 'lr' is what counts.
            'smooth', if there and not None, gets every tensor's change and returns what is made.
            'floor', if there, is a share of a tensor's mean gradient (root of its running square):
            entries with far less take small steps, where Adam's would all be of one size.
    """

    DECAYS, EPSILON = (0.9, 0.99), 1e-15

    def __init__(self, groups: list[dict]):
        self.param_groups = [{"lr": group["base"], **group} for group in groups]
        self._moments = [Moments(torch.zeros_like(p), torch.zeros_like(p)) for _, p in self._parameters()]
        self.count = 0

    def _parameters(self) -> list[tuple[dict, Tensor]]:
        return [(group, p) for group in self.param_groups for p in group["params"]]

    def step(self) -> None:
        """Move all parameters that have a gradient, and set it to zero."""
        self.count += 1
        for (group, parameter), moments in zip(self._parameters(), self._moments, strict=True):
            if parameter.grad is not None:
                self._move(group, parameter, moments)

    def _move(self, group: dict, parameter: Tensor, moments: Moments) -> None:
        epsilon = self._epsilon(parameter.grad, moments, group.get("floor", 0.0))
        rates = Rates(group["lr"], *self.DECAYS, epsilon, self.count)
        smooth = group.get("smooth")
        if smooth is None:
            adam_step(parameter.detach(), parameter.grad, moments, rates)
            return
        change = torch.zeros_like(parameter)
        adam_step(change, parameter.grad, moments, rates)
        parameter.detach().add_(smooth(change))

    def _epsilon(self, gradient: Tensor, moments: Moments, floor: float) -> float | Tensor:
        if floor <= 0:
            return self.EPSILON
        epsilon = floor * mean_root_square(gradient, moments, self.DECAYS[1], self.count)
        if isinstance(epsilon, float):
            return max(epsilon, self.EPSILON)
        return epsilon.clamp(min=self.EPSILON).view(1)

    def clear(self) -> None:
        """Forget the gradients of a step that came to nothing."""
        for _, parameter in self._parameters():
            if parameter.grad is not None:
                parameter.grad.zero_()

    def forget(self, parameter: Tensor) -> None:
        """What was learned of the gradient of a parameter that has been set anew."""
        for (_, own), moments in zip(self._parameters(), self._moments, strict=True):
            if own is parameter:
                moments.mean.zero_()
                moments.square.zero_()

    def state(self) -> dict[str, Tensor]:
        """For a checkpoint."""
        tensors = {"count": torch.tensor(self.count)}
        for index, moments in enumerate(self._moments):
            tensors |= {f"{index}.mean": moments.mean, f"{index}.square": moments.square}
        return tensors

    def restore(self, tensors: dict[str, Tensor]) -> None:
        self.count = int(tensors["count"])
        for index, moments in enumerate(self._moments):
            moments.mean.copy_(tensors[f"{index}.mean"])
            moments.square.copy_(tensors[f"{index}.square"])


def beginning_with(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Those of a checkpoint's tensors whose names begin so, by the rest of them."""
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
