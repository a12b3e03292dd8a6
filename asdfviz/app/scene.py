"""What hangs in viser's scene of one browser tab: picture, meshes, outlines, marks, cloud, gizmo.

Handles are made once and changed in place; `apply` brings them all to a snapshot in one message.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from asdfviz.app import actions as act
from asdfviz.app.ar import DRAWING_DEPTH, image_plane
from asdfviz.app.drawings import box_segments, depth_cloud, keypoint_dots, name_tags
from asdfviz.app.gizmo import Gizmo
from asdfviz.app.handles import move, put
from asdfviz.app.outlines import feature_edges
from asdfviz.app.playback import Ring
from asdfviz.app.snapshot import Snapshot
from asdfviz.app.theme import TRUTH, Rgb3, lighter
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import Detection, Frame
from asdfviz.geometry.shapes import Vector
from asdfviz.geometry.transforms import apply_to_point

_SELECTED: Rgb3 = (255, 255, 255)
_CLOUD_STRIDE = 2


class Scene:
    """The scene of one browser tab."""

    def __init__(
        self, client: Any, workspace: Workspace, emit: Callable[[act.Action], None]
    ) -> None:
        self._client = client
        self._scene = client.scene
        self._workspace = workspace
        self._emit = emit
        self._numbers = {name: i for i, name in enumerate(workspace.assembly.parts)}
        self._edges = {
            name: feature_edges(part.mesh) for name, part in workspace.assembly.parts.items()
        }
        self._frames: dict[str, Any] = {}
        self._meshes: dict[str, Any] = {}
        self._lines: dict[str, Any] = {}
        self._inks: dict[str, Rgb3] = {}
        self._layers: dict[tuple[str, str], Any] = {}
        self._marks: dict[str, Any] = {}
        self._tagged: Sequence[Detection] = ()
        self._cloud: Any = None
        self._cloud_place = -1
        self._mode, self._lens = "ar", workspace.frames.camera.K
        self.gizmo = Gizmo(self._scene, workspace, emit, self._frames)
        self.ring = Ring(self._scene, "/picture")
        self._prepare()

    def load(self, place: int, frame: Frame) -> bool:
        """Send a picture ahead of what belongs over it; False where it is there already."""
        camera = frame.camera
        plane = image_plane(camera.K, (camera.width, camera.height))
        return self.ring.load(place, frame.rgb, plane)

    def apply(self, snap: Snapshot) -> None:
        """Show a snapshot whose picture was loaded."""
        self._mode, self._lens = snap.view.mode, snap.facts.K
        self._apply_picture(snap)
        self._apply_parts(snap)
        self._apply_layers(snap)
        self._apply_marks(snap)
        self._apply_cloud(snap)
        self.gizmo.apply(snap)

    def middle(self, snap: Snapshot) -> Vector:
        """What the free camera looks at: the parts, or the depth, or half a metre ahead."""
        known = [
            apply_to_point(shown.T_camera_part, self._workspace.assembly.parts[name].middle)
            for name, shown in snap.poses.items()
        ]
        if known:
            return np.median(np.stack(known), axis=0)
        depth = None if snap.frame is None else snap.frame.depth
        near = depth[depth > 0] if depth is not None else np.zeros(0)
        return np.array([0.0, 0.0, float(np.median(near)) if near.size else 0.5])

    def _prepare(self) -> None:
        async def place(event: Any) -> None:
            x, y, z = event.ray_direction
            if z > 1e-6 and self._mode == "ar":  # elsewhere a click shows no pixel
                K = self._lens
                self._emit(act.PlacePart(K[0, 0] * x / z + K[0, 2], K[1, 1] * y / z + K[1, 2]))

        self._scene.on_click(modifier="shift")(place)

    def _apply_picture(self, snap: Snapshot) -> None:
        if snap.frame is not None:
            self.ring.show(snap.view.place)
        self.ring.set_visible(visible=snap.view.mode == "ar" and snap.frame is not None)

    def _apply_parts(self, snap: Snapshot) -> None:
        for name in self._numbers:
            shown = snap.poses.get(name)
            visible = shown is not None and snap.view.overlay and name not in snap.view.hidden
            if visible and name not in self._frames:
                self._make_part(name, snap.view)
            if name not in self._frames:
                continue
            if visible and shown is not None:
                move(self._frames[name], shown.T_camera_part)
                self._style(name, snap.view)
            put(self._frames[name], "visible", visible)

    def _make_part(self, name: str, view: View) -> None:
        part = self._workspace.assembly.parts[name]
        root = f"/parts/{self._numbers[name]}"
        self._frames[name] = self._scene.add_frame(root, show_axes=False)
        mesh = self._scene.add_mesh_simple(
            f"{root}/mesh",
            part.mesh.vertices.astype(np.float32),
            part.mesh.faces.astype(np.uint32),
            color=self._workspace.colors[name],
            opacity=view.opacity,
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

        async def select(_event: object) -> None:
            self._emit(act.SelectPart(name))

        mesh.on_click(select)
        self._meshes[name] = mesh
        self._lines[name] = self._add_lines(
            f"{root}/edges", self._edges[name], lighter(self._workspace.colors[name])
        )

    def _add_lines(self, name: str, segments: np.ndarray, color: Rgb3) -> Any:
        return self._scene.add_line_segments(
            name, segments, color, thickness=1.3, thickness_units="screen"
        )

    def _style(self, name: str, view: View) -> None:
        mesh, lines = self._meshes[name], self._lines[name]
        put(mesh, "visible", not view.xray)
        put(mesh, "opacity", view.opacity)
        selected = view.selected == name
        color = _SELECTED if selected else lighter(self._workspace.colors[name])
        self._paint(name, color)
        put(lines, "thickness", 2.4 if selected else 1.3)

    def _paint(self, name: str, color: Rgb3) -> None:
        if self._inks.get(name) != color:
            self._inks[name] = color
            self._lines[name].colors = np.array(color, np.uint8)

    def _apply_layers(self, snap: Snapshot) -> None:
        wanted: set[tuple[str, str]] = set()
        for layer in snap.view.layers:
            run = self._workspace.run(layer)
            color = run.color if run else TRUTH
            for name, T_camera_part in self._workspace.layer(snap.view.place, layer).items():
                if name not in self._numbers or name in snap.view.hidden:
                    continue
                wanted.add((layer, name))
                handle = self._layer(layer, name, color)
                move(handle, T_camera_part)
                put(handle, "visible", True)
        for key, handle in self._layers.items():
            if key not in wanted:
                put(handle, "visible", False)

    def _layer(self, layer: str, name: str, color: Rgb3) -> Any:
        key = (layer, name)
        if key not in self._layers:
            number = len(self._layers)
            self._layers[key] = self._add_lines(f"/layers/{number}", self._edges[name], color)
            self._layers[key].thickness = 1.6
        return self._layers[key]

    def _apply_marks(self, snap: Snapshot) -> None:
        """Boxes and keypoints are drawn just before the camera, where no mesh hides them."""
        ar = snap.view.mode == "ar" and snap.frame is not None
        found = snap.prediction.detections if snap.prediction else ()
        K = snap.facts.K
        segments, colors = box_segments(found, K, self._workspace.assembly, self._workspace.colors)
        if self._shown("boxes", wanted=ar and snap.view.boxes and len(segments) > 0):
            self._put_lines("boxes", segments, colors)
        dots, inks = keypoint_dots(found, K, self._workspace.assembly, self._workspace.colors)
        if self._shown("keypoints", wanted=ar and snap.view.keypoints and len(dots) > 0):
            self._put_lines("keypoints", dots, inks)
        # Pictures that follow each other fast are never decoded: tags are for frames that are looked at.
        named = (snap.view.boxes or snap.view.keypoints) and not snap.view.playing
        if self._shown("tags", wanted=ar and named and len(found) > 0):
            self._put_tags(found, snap)

    def _shown(self, key: str, *, wanted: bool) -> bool:
        if not wanted and key in self._marks:
            put(self._marks[key], "visible", False)
        return wanted

    def _put_lines(self, key: str, segments: np.ndarray, colors: np.ndarray) -> None:
        if key in self._marks:
            # Points and colours of another count cannot be set one after the other.
            self._marks[key].remove()
        self._marks[key] = self._scene.add_line_segments(
            f"/marks/{key}", segments, colors, thickness=2.0, thickness_units="screen"
        )

    def _put_tags(self, found: Sequence[Detection], snap: Snapshot) -> None:
        if "tags" in self._marks:
            if self._tagged is found:
                put(self._marks["tags"], "visible", True)
                return
            self._marks["tags"].remove()  # else those of another frame stay until these are decoded
        self._tagged = found
        size_wh, work = snap.facts.size_wh, self._workspace
        plane = image_plane(snap.facts.K, size_wh, depth=DRAWING_DEPTH)
        self._marks["tags"] = self._scene.add_image(
            "/marks/tags",
            name_tags(found, size_wh, work.assembly, work.colors),
            render_width=plane.width,
            render_height=plane.height,
            format="png",
            cast_shadow=False,
            receive_shadow=False,
            position=plane.position,
        )

    def _apply_cloud(self, snap: Snapshot) -> None:
        wanted = snap.view.mode == "3d" and snap.frame is not None and snap.frame.depth is not None
        if wanted and snap.frame is not None and self._cloud_place != snap.view.place:
            self._put_cloud(
                snap.frame, stride=2 * _CLOUD_STRIDE if snap.view.playing else _CLOUD_STRIDE
            )
            self._cloud_place = -1 if snap.view.playing else snap.view.place
        if self._cloud is not None:
            put(self._cloud, "visible", wanted)

    def _put_cloud(self, frame: Frame, *, stride: int) -> None:
        points, colors = depth_cloud(frame, stride=stride)
        size = (
            1.3
            * stride
            / float(frame.camera.K[0, 0])
            * float(np.median(points[:, 2]) if len(points) else 1)
        )
        if self._cloud is not None:
            self._cloud.remove()
        self._cloud = self._scene.add_point_cloud(
            "/cloud",
            points,
            colors,
            point_size=size,
            point_shape="square",
            point_shading="flat",
            precision="float32",
        )
