"""The state that `asdf_plus` and `asdf_track` follow: each frame's terms, and the model that joins them."""

from __future__ import annotations

from asdfviz.datatypes import StateEstimate
from asdfviz.geometry.shapes import Scores
from asdfviz.state.smoothing import StateFilter


def followed_state(
    states: StateFilter,
    looks: Scores | None,
    places: Scores | None,
    group_fit: Scores | None,
    place_looks: Scores | None,
) -> StateEstimate | None:
    """Take one frame's terms into the model; None before anything was ever seen.

    Args:
        states: the model.
        looks: the term "appearance".
        places: the term "relative_pose".
        group_fit: the term of that name.
        place_looks: the term of that name.
    """
    belief = states.step(looks, places, group_fit, place_looks)
    if belief is None:
        return None
    terms = {
        "appearance": looks,
        "relative_pose": places,
        "group_fit": group_fit,
        "place_looks": place_looks,
    }
    return StateEstimate(belief, {name: term for name, term in terms.items() if term is not None})
