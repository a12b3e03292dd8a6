"""Everything that one refresh of the page is made from, gathered once. Panels only read it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from asdfviz.annotate.records import PoseAnnotation
from asdfviz.app import theme, timeline
from asdfviz.app.items import ANNOTATION, Shown
from asdfviz.app.lanes import Lane
from asdfviz.app.view import Facts, View
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import Frame, FramePrediction


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """One person's view of the workspace at one moment."""

    view: View
    facts: Facts
    workspace: Workspace
    frame: Frame | None
    """None where the image cannot be read."""
    poses: dict[str, Shown]
    prediction: FramePrediction | None
    """What the base run says of this frame."""
    rows: tuple[timeline.Row, ...]
    said: Mapping[str, PoseAnnotation]
    """What was said by hand of parts in this frame."""
    lane: Lane
    """Where the selected part, or any, has a pose."""
    status: str = ""
    """What the last edit did."""

    @property
    def index(self) -> int:
        """Number of the frame in its file name."""
        return self.workspace.indices[self.view.place]

    @property
    def mark(self) -> tuple[timeline.Mark | None, str]:
        """The state of this frame and whose word it is."""
        return self.workspace.mark(self.view.place, self.view.base)

    def source_name(self, source: str) -> str:
        """How a pose's source is called."""
        run = self.workspace.run(source)
        return run.label if run else source

    def source_color(self, source: str) -> theme.Rgb3:
        """The colour of a pose's source."""
        run = self.workspace.run(source)
        if run:
            return run.color
        return theme.ANNOTATION if source == ANNOTATION else theme.TRUTH


def take(workspace: Workspace, view: View, *, frame: Frame | None, status: str = "") -> Snapshot:
    """Gather what a refresh needs."""
    run = workspace.run(view.base)
    index = workspace.indices[view.place]
    facts = workspace.facts()
    return Snapshot(
        view=view,
        # Each frame of a BOP scene may have intrinsics of its own.
        facts=facts if frame is None else replace(facts, K=frame.camera.K),
        workspace=workspace,
        frame=frame,
        poses=workspace.poses(view.place, view.base),
        prediction=run.by_place[view.place] if run else None,
        rows=workspace.rows(),
        lane=workspace.lane(view.selected, view.base),
        said={part: said for (_, part), said in workspace.store.poses(index).items()},
        status=status,
    )
