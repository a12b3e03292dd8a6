"""The pieces that several of our methods share, each off: rows of their ablations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from asdfviz.methods.at_rest_config import AtRestConfig
from asdfviz.methods.base_votes_config import BaseVotesConfig
from asdfviz.methods.contests import ContestsConfig
from asdfviz.methods.in_table import InTableConfig
from asdfviz.methods.joint_turns import JointTurnsConfig
from asdfviz.methods.loose_config import LooseConfig
from asdfviz.methods.lying import LyingConfig
from asdfviz.methods.named_nearby import NearbyConfig
from asdfviz.methods.on_table import NO_TABLE
from asdfviz.methods.own_colors import OwnColorsConfig
from asdfviz.methods.place_looks import PlaceLooksConfig
from asdfviz.methods.seen_smear import SmearConfig
from asdfviz.methods.shared_space import SharedSpaceConfig
from asdfviz.methods.strangers import StrangersConfig
from asdfviz.methods.thing_names import NamesConfig
from asdfviz.methods.unlike_twins import UnlikeTwinsConfig
from asdfviz.state.last_turns import LastTurnsConfig

UNNAMED = NamesConfig(enabled=False)
UNSOUGHT = NamesConfig(nearby=NearbyConfig(enabled=False))
TRUSTING = NamesConfig(strangers=StrangersConfig(enabled=False))
ANY_COLOR = UnlikeTwinsConfig(enabled=False)
BLIND = PlaceLooksConfig(enabled=False)
BY_CROPS = "looks from the crop network"
UNTOLD = BaseVotesConfig(enabled=False)
BEST_BOX = ContestsConfig(enabled=False)
SETTLED = JointTurnsConfig(enabled=False)
FAR = 100.0
"""Metres, or metres a second: farther and faster than anything."""
NEVER = 10**6
"""Frames."""


def common(config: Any) -> dict[str, Any]:
    """A config of `asdf_plus` or `asdf_track` with each of the pieces off that they share, by its title."""
    loose, smoothing = config.loose, config.smoothing
    unwatched = replace(loose, patience=1, untouched=0.0)
    return {
        "names by the detector alone": replace(config, names=UNNAMED),
        "no look at places": replace(config, place_looks=BLIND),
        "base where its pose says": replace(config, base_votes=UNTOLD),
        BY_CROPS: replace(config, state_looks="crops"),
        "base turned as found": replace(
            config, base_votes=replace(config.base_votes, known_turns=False)
        ),
        "hidden base by votes alone": replace(
            config, base_votes=replace(config.base_votes, stays=0.0)
        ),
        "joined though nothing came": replace(config, loose=unwatched),
        "left unwatched": replace(config, loose=replace(loose, left=0.0)),
        "large parts by looks alone": replace(config, loose=replace(loose, most_shown=0.0)),
        "brought by whoever passes": replace(config, loose=replace(loose, within=FAR)),
        "brought at any speed": replace(config, loose=replace(loose, speed=FAR)),
        "gone, but maybe hidden": replace(config, loose=replace(loose, empty=NEVER)),
        "blurred parts as large": replace(config, loose=replace(loose, blurred_px=loose.small_px)),
        "taken out unseen": replace(config, loose=replace(loose, seen_far=0.0)),
        "loose parts not counted": replace(config, loose=LooseConfig(enabled=False)),
        "hidden parts turned anyhow": replace(config, last_turns=LastTurnsConfig(enabled=False)),
        "no step half done": replace(
            config, relative_pose=replace(config.relative_pose, half_done=0.0)
        ),
        "places as sure in blur": replace(
            config, relative_pose=replace(config.relative_pose, shaken=1.0)
        ),
        "black as bright": replace(config, group_fit=replace(config.group_fit, black=0.0)),
        "errors last as steps do": replace(
            config, smoothing=replace(smoothing, stay_wrong=smoothing.stay)
        ),
        "parts of a step together": replace(config, smoothing=replace(smoothing, at_once=1.0)),
        "no contests": replace(config, contests=BEST_BOX),
        "no strangers": replace(config, names=TRUSTING),
        "missing parts not looked for": replace(config, names=UNSOUGHT),
        "camera not followed": replace(config, at_rest=AtRestConfig(enabled=False)),
        "not told as lying": replace(config, lying=LyingConfig(enabled=False)),
        "turned in joints as settled": replace(config, joint_turns=SETTLED),
        "edges smeared alike": replace(config, smear=SmearConfig(enabled=False)),
        "elsewhere of any colour": replace(config, own_colors=OwnColorsConfig(enabled=False)),
        "twins of any colour": replace(config, unlike_twins=ANY_COLOR),
        "poses in the table": replace(config, in_table=InTableConfig(enabled=False)),
        "loose parts in one another": replace(
            config, shared_space=SharedSpaceConfig(enabled=False)
        ),
        "told as settled": replace(
            config, laid=NO_TABLE, lying=LyingConfig(enabled=False), joint_turns=SETTLED
        ),
    }
