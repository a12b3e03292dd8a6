from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly
from asdfviz.detector.crop_classes import crop_classes, group_states
from asdfviz.detector.crop_cut import CROP_PIXELS
from asdfviz.detector.crop_network import CropNetwork
from asdfviz.detector.crop_weights import load_crop_network, save_crop_network
from asdfviz.errors import InputError, WeightsError
from asdfviz.geometry.rotation_grid import rotation_of
from asdfviz.geometry.symmetry import nearest_symmetric
from asdfviz.geometry.transforms import apply, rotation_angle, transform_from
from asdfviz.state.half_done import HalfDone
from asdfviz.train.checkpoint import Average, Progress
from asdfviz.train.crop_checkpoint import begin_crops_from, save_crop_checkpoint
from asdfviz.train.crop_config import CropTrainConfig
from asdfviz.train.crop_data import CropMaker, Crops
from asdfviz.train.crop_losses import crop_losses
from asdfviz.train.crop_pool import CropPool, ShardFolder
from asdfviz.train.crop_scenes import CropConfig, CropDrawer
from asdfviz.train.crop_session import DRAWN, CropSession
from asdfviz.train.crop_views import ViewMaker
from asdfviz.train.schedule import rate_at

STATES = {"a//group": ["s", "t"]}


@pytest.fixture(scope="module")
def maker(assembly: Assembly) -> CropMaker:
    return CropMaker([assembly])


@pytest.fixture(scope="module")
def crops(maker: CropMaker) -> Crops:
    return maker.make(24, rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def views(assembly: Assembly) -> ViewMaker:
    return ViewMaker(crop_classes([assembly]), grid=600)


def pixels_of(points: np.ndarray, focal: float, side: int) -> np.ndarray:
    return np.rint(points[:, :2] / points[:, 2:] * focal + (side - 1) / 2).astype(int)


def test_where_a_crop_shows_the_part_its_pose_projects_to(assembly, maker, crops) -> None:
    side = crops.pictures.shape[3]
    for i in range(len(crops)):
        part = assembly.parts[maker.classes[int(crops.labels[i])].parts[0]]
        T = crops.T_crop_part[i].double().numpy()
        if crops.states[i] >= 0 or crops.names[i] == len(maker.classes):
            continue  # of a group the rest hides the base part; nothing known has no pose
        corners = apply(T, part.mesh.vertices)
        low, high = (
            f(pixels_of(corners, float(crops.focal[i]), side), axis=0) for f in (np.min, np.max)
        )
        rows, columns = np.nonzero(crops.pictures[i, 3].numpy())
        assert columns.min() >= low[0] - 1
        assert columns.max() <= high[0] + 1
        assert rows.min() >= low[1] - 1
        assert rows.max() <= high[1] + 1
        # The box lies about the middle and has the size that crops are cut for.
        assert (low + high) / 2 == pytest.approx([(side - 1) / 2] * 2, abs=1.5)
        assert (high - low).max() == pytest.approx(CROP_PIXELS / 1.25, abs=3)


def test_a_group_lies_about_the_middle_and_has_all_that_the_state_joins(
    assembly: Assembly, maker: CropMaker
) -> None:
    groups = [i for i, c in enumerate(maker.classes) if c.states]
    crops = maker.make(24, rng=np.random.default_rng(3), labels=groups)
    states = maker.classes[groups[0]].states
    assert set(crops.states.tolist()) <= set(range(len(states)))
    assert len(set(crops.states.tolist())) > 1
    side = crops.pictures.shape[3]
    shown = 0
    for i in range(len(crops)):
        T = crops.T_crop_part[i].double().numpy()
        middle = apply(T, maker.classes[groups[0]].middle[None])
        at = pixels_of(middle, float(crops.focal[i]), side)[0]
        assert at == pytest.approx([(side - 1) / 2] * 2, abs=1.5)
        state = assembly.states[int(crops.states[i])]
        corners = np.concatenate(
            [
                apply(T @ T_base_part, assembly.parts[name].mesh.vertices)
                for name, T_base_part in state.T_base_part.items()
                if name not in state.joints
            ]
        )
        pixels = pixels_of(corners, float(crops.focal[i]), side)
        shown += bool(np.all((pixels >= 0) & (pixels < side)))
    assert shown >= 0.8 * len(crops)


def test_a_group_shows_half_a_step_for_the_step_before() -> None:
    caliper = load_assembly("geared_caliper")
    step, halves = next(iter(HalfDone.of(caliper).halves.items()))
    label = len(crop_classes([caliper])) - 1
    bare = CropConfig(
        groups=1.0, half_done=1.0, waiting=0.0, neighbours=0.0, occluder=0.0, hand=0.0
    )
    drawer = CropDrawer([caliper], config=bare)
    rng = np.random.default_rng(0)
    shown = {
        len(scene.things)
        for scene in (drawer.draw(rng, label) for _ in range(60))
        if scene.state == step
    }
    assert shown == {len(half.T_base_part) for half in halves}


def test_a_group_learns_among_its_own_states(assembly: Assembly) -> None:
    other = load_assembly("corner_clamp")
    classes = crop_classes([assembly, other])
    views = ViewMaker(classes, grid=60)
    count = sum(len(c.states) for c in classes)
    labels = torch.tensor([len(classes) - 2, len(classes) - 1])
    own = views.own_states(torch.zeros(2, count), labels)
    first = len(assembly.states)
    assert torch.isfinite(own[0]).tolist() == [i < first for i in range(count)]
    assert torch.isfinite(own[1]).tolist() == [i >= first for i in range(count)]


def test_parts_say_nothing_of_states(maker: CropMaker, crops: Crops, views: ViewMaker) -> None:
    batch = views.views(crops, rng=np.random.default_rng(1))
    target = views.targets(batch.quaternions, batch.labels)
    count = sum(len(c.states) for c in maker.classes)
    network = CropNetwork(classes=len(maker.classes), grid=600, states=count)
    out = network(batch.pictures, batch.labels)
    names = network.names(batch.pictures, batch.sizes)
    losses = crop_losses(out, names, batch, target=target, views=views)
    assert bool(torch.isfinite(losses).all())
    parts = batch.states < 0
    changed = replace(out, states=torch.where(parts[:, None], out.states + 5, out.states * 1.0))
    changed.states[parts, 0] += 9
    assert torch.allclose(losses, crop_losses(changed, names, batch, target=target, views=views))
    alone = replace(batch, states=torch.full_like(batch.states, -1))
    assert float(crop_losses(out, names, alone, target=target, views=views)[3].detach()) == 0.0


def test_crops_of_nothing_known_teach_only_that(
    maker: CropMaker, views: ViewMaker, assembly: Assembly
) -> None:
    count = len(maker.classes)
    parts = [i for i, c in enumerate(maker.classes) if not c.states]
    crops = maker.make(64, rng=np.random.default_rng(5), labels=parts)
    nothing = crops.names == count
    assert 2 <= int(nothing.sum()) <= 24
    assert torch.equal(crops.names[~nothing], crops.labels[~nothing])
    batch = views.views(crops, rng=np.random.default_rng(1))
    target = views.targets(batch.quaternions, batch.labels)
    network = CropNetwork(classes=count, grid=600, states=len(assembly.states), names=True)
    out = network(batch.pictures, batch.labels)
    names = network.names(batch.pictures, batch.sizes)
    losses = crop_losses(out, names, batch, target=target, views=views)
    changed = replace(
        out, rotations=torch.where(nothing[:, None], 9 * out.rotations, out.rotations)
    )
    changed.place[nothing] += 1
    changed.outline[nothing] += 1
    assert torch.allclose(losses, crop_losses(changed, names, batch, target=target, views=views))
    right = torch.nn.functional.one_hot(crops.names, count + 1) * 20.0
    sure = crop_losses(out, right, batch, target=target, views=views)
    assert float(sure[4].detach()) < 0.5 < float(losses[4].detach())
    assert (
        float(crop_losses(out, right[:, :0], batch, target=target, views=views)[4].detach()) == 0.0
    )


def test_crops_of_nothing_known_alone_teach_names_alone(
    maker: CropMaker, crops: Crops, views: ViewMaker
) -> None:
    batch = views.views(crops, rng=np.random.default_rng(1))
    nothing = torch.full_like(batch.names, views.nothing)
    alone = replace(batch, names=nothing, states=torch.full_like(batch.states, -1))
    target = views.targets(batch.quaternions, batch.labels)
    count = len(maker.classes)
    network = CropNetwork(classes=count, grid=600, states=2, names=True)
    out = network(batch.pictures, batch.labels)
    names = network.names(batch.pictures, batch.sizes)
    losses = crop_losses(out, names, alone, target=target, views=views)
    assert losses[:4].tolist() == [0.0] * 4
    assert float(losses[4].detach()) > 0
    losses.sum().backward()
    assert all(p.grad.isfinite().all() for p in network.parameters() if p.grad is not None)


def test_groups_have_no_name(maker: CropMaker) -> None:
    groups = [i for i, c in enumerate(maker.classes) if c.states]
    crops = maker.make(8, rng=np.random.default_rng(3), labels=groups)
    assert crops.names.tolist() == [-1] * 8


def test_the_same_seed_makes_the_same_crops(maker: CropMaker, crops: Crops) -> None:
    again = maker.make(24, rng=np.random.default_rng(0))
    assert torch.equal(again.pictures, crops.pictures)
    assert torch.equal(again.T_crop_part, crops.T_crop_part)


def test_crops_come_back_from_disk(crops: Crops, tmp_path: Path) -> None:
    crops.save(tmp_path / "shard_1.npz")
    again = Crops.load(tmp_path / "shard_1.npz")
    assert torch.equal(again.pictures, crops.pictures)
    assert torch.equal(again.labels, crops.labels)
    (tmp_path / "shard_2.npz").write_bytes((tmp_path / "shard_1.npz").read_bytes()[:5000])
    with pytest.raises(InputError, match="shard_2"):
        Crops.load(tmp_path / "shard_2.npz")


def test_views_keep_the_truth(assembly, maker, crops, views) -> None:
    """In any rolled and shifted view the part's outline lies where its new pose projects to."""
    batch = views.views(crops, rng=np.random.default_rng(1))
    for i in range(len(crops)):
        part_class = maker.classes[int(batch.labels[i])]
        part = assembly.parts[part_class.parts[0]]
        R = rotation_of(batch.quaternions[i].double().numpy())
        x, y, size = batch.place[i].tolist()
        # Depth 1 along the axis: the focal length follows from the size.
        focal = float(np.exp(size)) * CROP_PIXELS / part_class.diameter
        middle = np.array([x, y, 0]) * CROP_PIXELS / 2 / focal + [0, 0, 1]
        t = middle - R @ part_class.middle
        distance = float(crops.T_crop_part[i, 2, 3])
        corners = part.mesh.vertices @ R.T + t
        corners[:, 2] = 1 + (corners[:, 2] - 1) / distance  # true perspective is weaker or stronger
        uv = corners[:, :2] * focal + (CROP_PIXELS - 1) / 2
        rows, columns = np.nonzero(batch.outline[i].numpy() > 0.6)
        cells = np.stack([columns, rows], axis=1) * 4 + 1.5
        assert np.all(cells >= uv.min(axis=0) - 7)
        assert np.all(cells <= uv.max(axis=0) + 7)


def test_boxes_are_as_large_as_what_they_are_cut_about(assembly, maker, views) -> None:
    parts = [i for i, c in enumerate(maker.classes) if not c.states]
    crops = maker.make(24, rng=np.random.default_rng(7), labels=parts)
    exact = views.views(crops, rng=np.random.default_rng(2), jitter=0.0)
    for i in range(len(crops)):
        part_class = maker.classes[int(crops.labels[i])]
        corners = apply(crops.T_crop_part[i].double().numpy(), part_class.corners)
        flat = corners[:, :2] / corners[:, 2:]
        side = np.ptp(flat, axis=0).max() * float(crops.T_crop_part[i, 2, 3])
        assert float(exact.sizes[i]) == pytest.approx(side, rel=0.1)
        assert float(exact.sizes[i]) < 1.3 * part_class.diameter
    measured = torch.cat(
        [views.views(crops, rng=np.random.default_rng(seed)).sizes for seed in range(20)]
    )
    assert 0.05 < float(measured.isnan().float().mean()) < 0.25, "depth has holes"


def test_a_roll_turns_the_pose_with_the_picture(crops: Crops, views: ViewMaker) -> None:
    still = views.views(crops, rng=np.random.default_rng(2), jitter=0.0)
    turned = views.views(crops, rng=np.random.default_rng(2))
    for i in range(len(crops)):
        R = rotation_of(turned.quaternions[i].double().numpy()) @ (
            rotation_of(still.quaternions[i].double().numpy()).T
        )
        assert R[2, 2] > 0.98  # about the axis, but for the shift of the box


def test_symmetric_rotations_are_equal_targets(assembly: Assembly, views: ViewMaker) -> None:
    """The bar has a half turn about z: both rotations give one target, with two peaks."""
    grid = views.angles(torch.tensor([[0.1, 0.2, 0.3, 0.927]]), torch.tensor([1]))
    turned = torch.tensor([[0.2, -0.1, 0.927, -0.3]])  # the same rotation after the half turn
    assert torch.allclose(grid, views.angles(turned, torch.tensor([1])), atol=2e-3)
    bar = assembly.parts["bar"]
    one, other = (
        transform_from(rotation_of(np.array(q)), np.zeros(3))
        for q in ([0.1, 0.2, 0.3, 0.927], [0.2, -0.1, 0.927, -0.3])
    )
    nearest = nearest_symmetric(one, other, bar.symmetries)
    assert rotation_angle(nearest[:3, :3].T @ other[:3, :3]) < 1e-3
    target = views.targets(turned, torch.tensor([1]))[0]
    assert float(target.sum()) == pytest.approx(1)
    alone = views.targets(turned, torch.tensor([0]))[0]
    assert int((target > 0.01).sum()) == pytest.approx(2 * int((alone > 0.01).sum()), abs=6)


def test_the_pool_forgets_the_oldest(crops: Crops, tmp_path: Path) -> None:
    folder = ShardFolder(tmp_path, size=2)
    for number in range(3):
        crops.taken(torch.full((2,), number)).save(tmp_path / f"shard_{number:03d}.npz")
    pool = CropPool(2)
    for shard in folder.fresh(limit=5):
        pool.add(shard)
    assert len(pool) == 2
    assert sorted(p.name for p in tmp_path.glob("*.npz")) == ["shard_001.npz", "shard_002.npz"]
    assert folder.fresh(limit=5) == []
    assert len(pool.draw(7, rng=np.random.default_rng(0))) == 7


def run_config(folder: Path, **values: object) -> CropTrainConfig:
    chosen: dict[str, object] = {
        "assemblies": ("corner_clamp",),
        "output": folder,
        "steps": 4,
        "batch": 8,
        "grid": 120,
        "generators": 0,
        "validation_crops": 2,
        "bfloat16": False,
        "first_shards": 1,
    } | values
    return CropTrainConfig(**chosen)  # pyright: ignore[reportArgumentType]


def left_of(folder: Path) -> tuple[int, list[object]]:
    """Of how many steps the weights in a run folder are, and what was said of them."""
    assert load_crop_network(folder / "crops.safetensors").classes
    record = json.loads((folder / "crops.json").read_text())
    return record["steps"], record["validation"]


def test_a_run_trains_stops_goes_on_and_exports(tmp_path: Path) -> None:
    (tmp_path / "pool").mkdir()
    clamp = CropMaker([load_assembly("corner_clamp")])
    clamp.make(16, rng=np.random.default_rng(0)).save(tmp_path / "pool" / "shard_1.npz")
    session = CropSession(run_config(tmp_path))
    steps: list[int] = []
    assert not session.go(lambda report: None, lambda: session.progress.step >= 2)
    assert left_of(tmp_path) == (2, [])
    before = {k: v.clone() for k, v in session.network.state_dict().items()}
    again = CropSession(run_config(tmp_path))
    assert again.progress.step == 2
    assert all(torch.equal(v, before[k]) for k, v in again.network.state_dict().items())
    assert not again.go(lambda report: None, lambda: again.progress.step >= 3)
    assert left_of(tmp_path) == (3, [])  # nor were the first ones judged
    assert again.go(lambda report: steps.append(report.step), lambda: False)
    assert steps[-1] == 4
    found = again.validate()
    assert [score.crops for score in found[0].classes]
    assert "mean over classes" in found[0].table()
    loaded = load_crop_network(tmp_path / "crops.safetensors")
    parts = ("corner_clamp/base", "corner_clamp/jaw", "corner_clamp/bolt")
    assert loaded.classes == (*parts, "corner_clamp//group")
    assert loaded.states == {"corner_clamp//group": ("base", "jaw", "bolt", "jaw_reversed")}
    record = json.loads((tmp_path / "crops.json").read_text(), parse_constant=pytest.fail)
    assert record["states"] == {"corner_clamp//group": ["base", "jaw", "bolt", "jaw_reversed"]}
    assert [score["label"] for score in record["validation"][0]["classes"]]
    assert (tmp_path / "curve.png").is_file()
    judged = (tmp_path / "crops.json").read_text()
    longer = CropSession(run_config(tmp_path, steps=6))
    longer.progress.best = again.progress.best
    assert not longer.go(lambda report: None, lambda: longer.progress.step >= 5)
    assert (tmp_path / "crops.json").read_text() == judged  # the best so far
    with pytest.raises(WeightsError, match="another run folder"):
        CropSession(run_config(tmp_path, grid=240))


@pytest.mark.parametrize("teach", ["names", "poses"])
def test_names_and_all_the_rest_can_be_taught_alone(tmp_path: Path, teach: str) -> None:
    (tmp_path / "run" / "pool").mkdir(parents=True)
    clamp = CropMaker([load_assembly("corner_clamp")], config=DRAWN[teach])
    made = clamp.make(16, rng=np.random.default_rng(0))
    made.save(tmp_path / "run" / "pool" / "shard_1.npz")
    start = tmp_path / "crops.safetensors"
    classes, states = [c.name for c in clamp.classes], group_states(clamp.classes)
    count = sum(len(of) for of in states.values())
    network = CropNetwork(classes=len(classes), grid=120, states=count, names=True)
    save_crop_network(network, start, classes=classes, states=states)
    session = CropSession(run_config(tmp_path / "run", start=start, teach=teach))
    before = {k: v.clone() for k, v in session.network.state_dict().items()}
    assert session.go(lambda report: None, lambda: False)
    learned = {k for k, v in session.network.state_dict().items() if not torch.equal(v, before[k])}
    assert {name.startswith("name.") for name in learned} == {teach == "names"}
    assert ("name.know_size.bias" if teach == "names" else "to_grid.weight") in learned
    assert session.validate()
    assert session.progress.best >= 0  # nothing was judged before
    assert not (tmp_path / "crops.json").exists()
    assert load_crop_network(tmp_path / "run" / "crops.safetensors").network.tells_names


def test_names_alone_need_a_beginning(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name the weights to begin with"):
        CropSession(run_config(tmp_path, teach="names"))


def test_an_empty_pool_without_generators_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no crops to train on"):
        CropSession(run_config(tmp_path)).go(lambda report: None, lambda: False)


@pytest.mark.parametrize(
    "wrong", [{"minutes": 0.0}, {"batch": 1}, {"assemblies": ()}, {"learning_rate": 0.0}]
)
def test_impossible_runs_are_refused(tmp_path: Path, wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        CropSession(run_config(tmp_path, **wrong))


def test_the_rate_warms_up_holds_and_falls() -> None:
    config = CropTrainConfig(("a",), Path("x"))
    assert rate_at(config, 0, 0.0) < 0.01 * config.learning_rate
    assert rate_at(config, 1000, 0.4) == pytest.approx(config.learning_rate)
    assert rate_at(config, 1000, 1.0) == pytest.approx(0.02 * config.learning_rate)


def test_a_run_begins_with_what_another_ones_classes_share(tmp_path: Path) -> None:
    torch.manual_seed(1)
    old, new = CropNetwork(classes=2, grid=64, states=2), CropNetwork(classes=3, grid=64, states=2)
    checkpoint = tmp_path / "last.pt"
    save_crop_checkpoint(
        checkpoint,
        network=old,
        average=Average(old, decay=0.9),
        progress=Progress(),
        optimizer=torch.optim.AdamW(old.parameters()),
        about={"classes": ["a/x", "a/y"], "states": STATES, "shape": old.shape},
    )
    assert new.to_states is not None
    assert old.to_states is not None
    own = new.to_states.weight.clone()
    begin_crops_from(new, checkpoint, names=["b/x", "a/y", "b/z"], states={"b//group": ["s", "t"]})
    assert torch.equal(new.to_states.weight, own)
    begin_crops_from(new, checkpoint, names=["b/x", "a/y", "b/z"], states=STATES)
    assert torch.equal(new.to_states.weight, old.to_states.weight)
    assert torch.equal(new.features.weight, old.features.weight)
    assert torch.equal(new.to_grid.weight, old.to_grid.weight)
    rows = old.own_layer.weight.view(2, -1)
    assert torch.equal(new.own_layer.weight.view(3, -1)[1], rows[1])
    assert torch.allclose(new.own_layer.weight.view(3, -1)[0], rows.mean(0))
    table, before = new.know_quarter.table.weight, old.know_quarter.table.weight
    assert torch.equal(table[1], before[1])
    with pytest.raises(WeightsError, match="has the shape"):
        begin_crops_from(CropNetwork(classes=2, grid=128), checkpoint, names=["p", "q"], states={})
