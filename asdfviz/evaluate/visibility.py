"""How much of every true part can be seen: from the dataset where it says so, else by rendering.

Feeds the protocols, which do not ask for what nobody could see.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from asdfviz.datatypes import Assembly, Camera, FrameTruth
from asdfviz.errors import SequenceError


def visible_shares(
    truth: Iterable[FrameTruth], *, assembly: Assembly, camera: Camera | None
) -> dict[int, dict[str, float]]:
    """Return the visible share (0 to 1) of every true part, by frame number and part.

    What the truth says (BOP's visib_fract) is taken; only frames that lack a part are rendered.

    Raises:
        SequenceError: something has to be rendered and there is no camera.
    """
    frames = {frame.frame_index: frame for frame in truth}
    shares = {
        index: {name: share for name, share in frame.visible.items() if name in assembly.parts}
        for index, frame in frames.items()
    }
    unknown = {i: frame for i, frame in frames.items() if lacks_visibility(frame, assembly)}
    if not unknown:
        return shares
    if camera is None:
        raise SequenceError(
            f"frame {min(unknown)}: the truth does not say how much of each part is visible "
            "(scene_gt_info.json) and there is no camera to render it with"
        )
    for index, rendered in _rendered_shares(unknown, assembly, camera).items():
        shares[index] = {**rendered, **shares[index]}
    return shares


def lacks_visibility(frame: FrameTruth, assembly: Assembly) -> bool:
    """Whether a part of the frame has a true pose but no visible share."""
    return any(name in assembly.parts and name not in frame.visible for name in frame.T_camera_part)


def _rendered_shares(
    frames: Mapping[int, FrameTruth], assembly: Assembly, camera: Camera
) -> dict[int, dict[str, float]]:
    # OpenGL is loaded only for datasets that leave the shares out.
    from asdfviz.render.renderer import Renderer
    from asdfviz.render.visibility import visible_fractions

    renderer = Renderer(camera.width, camera.height)
    try:
        return {
            index: dict(
                visible_fractions(
                    {n: T for n, T in frame.T_camera_part.items() if n in assembly.parts},
                    assembly,
                    camera,
                    renderer=renderer,
                )
            )
            for index, frame in frames.items()
        }
    finally:
        renderer.close()
