"""How much of every true part can be seen: from the dataset where it says so, else by rendering.

Feeds the protocols, which do not ask for what nobody could see.
"""

from __future__ import annotations

from collections.abc import Iterable

from asdfviz.datatypes import Assembly, FrameTruth
from asdfviz.errors import SequenceError
from asdfviz.evaluate.bop import Views
from asdfviz.render.visibility import MissingShares, lacks_visibility


def visible_shares(
    truth: Iterable[FrameTruth], *, assembly: Assembly, views: Views | None
) -> dict[int, dict[str, float]]:
    """Return the visible share (0 to 1) of every true part, by frame number and part.

    What the truth says (BOP's visib_fract) is taken; only frames that lack a part are rendered, and
    there what was measured in front of a part hides it, as in BOP.

    Raises:
        SequenceError: something has to be rendered and there is no camera, or the frame cannot be read.
    """
    shares: dict[int, dict[str, float]] = {}
    with MissingShares(assembly) as missing:
        for frame in truth:
            if lacks_visibility(frame, assembly):
                if views is None:
                    raise SequenceError(
                        f"frame {frame.frame_index}: the truth does not say how much of each part is "
                        "visible (scene_gt_info.json) and there is no camera to render it with"
                    )
                view = views(frame.frame_index)
                frame = missing.filled(frame, view.camera, view.depth)
            known = frame.visible.items()
            shares[frame.frame_index] = {n: share for n, share in known if n in assembly.parts}
    return shares
