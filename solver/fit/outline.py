"""Where an object ends in a photo: along edges, as far as what each pixel says allows.

A minimal cut of the pixels' graph (Boykov and Jolly 2001, doi:10.1109/ICCV.2001.937505), by the algorithm
of Boykov and Kolmogorov (2004, doi:10.1109/TPAMI.2004.60).
"""

import maxflow
import numpy as np

ANYWHERE = 0.3
"""what it costs an outline to pass along the strongest edge"""
ACROSS = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 0]])
DOWN = np.array([[0, 0, 0], [0, 0, 0], [0, 1, 0]])


def cut(colour: np.ndarray, evidence: np.ndarray, within: float) -> np.ndarray:
    """[H, W] bool: the object, by evidence [H, W] (logarithm of the odds that a pixel shows it).

    Args:
        colour: [H, W, 3], of which differences are perceived alike (CIE Lab).
        within: what it costs an outline to pass between two pixels of one colour, times the root of all
            pixels, for evidence is of areas.
    """
    across = ((colour[:, 1:] - colour[:, :-1]) ** 2).sum(-1)
    down = ((colour[1:] - colour[:-1]) ** 2).sum(-1)
    usual = max(float(across.mean() + down.mean()), 1e-6)
    graph = maxflow.GraphFloat()
    nodes = graph.add_grid_nodes(evidence.shape)
    for difference, structure, axis in ((across, ACROSS, 1), (down, DOWN, 0)):
        weight = within * evidence.size**0.5 * np.exp(-difference / usual) + ANYWHERE
        weight = np.insert(weight, weight.shape[axis], 0, axis=axis)
        graph.add_grid_edges(nodes, weight, structure=structure, symmetric=True)
    graph.add_grid_tedges(nodes, np.maximum(evidence, 0), np.maximum(-evidence, 0))
    graph.maxflow()
    return ~graph.get_grid_segments(nodes)
