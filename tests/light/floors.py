"""A light of which a floor is close by."""

import numpy as np
import torch

from solver.light.environment import EnvironmentMap, equirect_directions


def stripes(places):
    """What the floor shows [N] at world points [N, 3]."""
    return 1 + 0.8 * np.sin(3 * places[..., 0])


def striped(floor, height, sky=0.1):
    """A light whose floor has stripes, in world units across, under an even sky."""
    directions = equirect_directions(height, 2 * height).view(-1, 3)
    places, on_floor = floor.places(directions.numpy())
    colour = np.where(on_floor, stripes(places), sky)
    radiance = torch.from_numpy(colour).float().view(height, -1, 1).expand(-1, -1, 3)
    light = EnvironmentMap.from_radiance(radiance)
    light.floor = floor
    return light
