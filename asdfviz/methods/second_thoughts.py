"""The decided poses settled by contours, and the runner-up instead where contours speak for it alone.

Not in the paper. A flat thing agrees with the depth of the table that it would lie in, so a pose that was
taken once, behind a hand, may go on being trusted more than the right one beside it. Its contours are not
there, though, and those of the right one are.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from asdfviz.datatypes import Frame
from asdfviz.methods.contour_fits import ContourFit, ContourFits
from asdfviz.methods.kept_poses import Decision
from asdfviz.methods.looked_at import LookedAt
from asdfviz.methods.part_hypotheses import PartHypotheses


def settled_by_contours(
    contours: ContourFits | None,
    hypotheses: Mapping[str, PartHypotheses],
    decided: Mapping[str, Decision],
    frame: Frame,
    *,
    held: Collection[str],
    looked_at: Mapping[str, LookedAt],
) -> tuple[dict[str, Decision], dict[str, ContourFit]]:
    """The decided poses and what contours make of them; hypotheses go on from there.

    Args:
        contours: settles poses; None leaves everything as it is.
        hypotheses: of every part; changed.
        decided: the most trusted pose of each part that has one.
        frame: with depth; nothing is said without.
        held: parts that the state holds in their places.
        looked_at: what crops tell of the parts.
    """
    if contours is None:
        return dict(decided), {}
    poses = {name: decision.best.T_camera_part for name, decision in decided.items()}
    fits = contours.step(frame, poses, held=held, looked_at=looked_at)
    chosen = dict(decided)
    for name, fit in fits.items():
        rival = decided[name].rival
        if rival and (other := contours.rather(frame, name, fit, rival.T_camera_part)):
            hypotheses[name].disown()
            chosen[name], fits[name] = Decision(rival, rival.trust), other
        if fits[name].moved:
            hypotheses[name].move(fits[name].T_camera_part)
    return chosen, fits
