"""Everything that a solve knows at some moment. Camera frame."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from engine.progress import Progress
from engine.surface.data.pyramid import finer
from engine.surface.data.scene import Picture, Scene
from engine.surface.lighting.distance_search import Distance
from engine.surface.lighting.grouped_light import Parts
from engine.surface.lighting.light_calibration import Setting
from engine.surface.lighting.room_light import Room
from engine.surface.optimize.gauss_newton import State
from engine.surface.optimize.pixel_sample import Sample
from engine.surface.rendering.object_pixels import Subject
from engine.surface.rendering.transport import Incident, Sight
from engine.surface.uncertainty.standard_errors import Doubt


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The surface of the object's pixels at one size, and the light it is solved under."""

    level: int  # of `Scene.at`
    views: Int[np.ndarray, " n"]  # that `who` is seen in
    who: Subject
    room: Room
    distance: Distance
    sight: Sight
    state: State | None = None  # None: nothing is known yet
    depth: Float[np.ndarray, "h w"] | None = None
    # The light by groups of emitters, as long as it is calibrated.
    parts: Parts | None = None
    setting: Setting | None = None
    first_setting: Setting | None = None  # that of the distance search
    probe_distance: float = 0.0  # distance that the probes were put around; 0: around no depth yet
    lit_by_shading: bool = False  # part of the light is as bright as the object's shading makes it
    search_again: bool = False  # the light has turned out other than normals were sought under
    voters: tuple[Sample, State] | None = None  # pixels that calibrated the light
    light_variance: Doubt | None = None  # what they leave open of it
    # The light as it is settled, in the views that are fitted and those that are not.
    picture: Picture | None = None  # that all views' pixels are of
    light: Incident | None = None
    validation: Incident | None = None
    exposure_offset: Float[np.ndarray, " n"] | None = None
    halved_state: State | None = None  # as the last smaller size left it, for the pixels of `state`
    coarse_state: State | None = None  # as the coarse phases left it, for the same
    regularized: bool = False
    residuals: tuple[float, ...] = ()  # median spread of the weighted residuals after each iteration
    coarse_iterations: int = 0  # of these, those before the light was settled

    @property
    def pixels(self) -> Subject:
        """The object's pixels without what their views' exposures are off by."""
        if self.setting is None or not self.room.drift or self.light is not None:
            return self.who
        return self.who.exposed(self.setting.drift)

    @property
    def incident(self) -> Incident:
        """The light as it stands."""
        if self.light is not None:
            return self.light
        return self.known_parts.under(self.known_setting.gain, self.known_setting.aside)

    @property
    def known_parts(self) -> Parts:
        """The light by groups; known once it is gathered."""
        assert self.parts is not None
        return self.parts

    @property
    def known_setting(self) -> Setting:
        """Distance and brightnesses; known once the light is gathered."""
        assert self.setting is not None
        return self.setting

    @property
    def known_state(self) -> State:
        """The pixels' answers; known once normals were sought."""
        assert self.state is not None
        return self.state

    @property
    def known_depth(self) -> Float[np.ndarray, "h w"]:
        """The depth; known once normals were integrated."""
        assert self.depth is not None
        return self.depth

    def with_material(self, material: Float[np.ndarray, "p 2"] | None) -> "Estimate":
        """The same of another material."""
        return replace(
            self, who=replace(self.who, material=material), sight=replace(self.sight, material=material)
        )

    def calibrated(self, setting: Setting) -> "Estimate":
        """The same under another calibration of the light; the object moves to where it has it."""
        by = setting.distance / self.distance.value
        distance = replace(self.distance, value=setting.distance)
        return replace(
            self, setting=setting, distance=distance, sight=self.sight.at(by), depth=self.known_depth * by
        )

    def upsampled(self, scene: Scene, progress: Progress) -> "Estimate":
        """The same for the pixels of a picture twice as large."""
        who = scene.coarse[self.level - 1].pixels(np.arange(len(scene.coarse_views)), scene.params)
        who, state, depth, sight = finer(
            who, self.who, self.known_state, self.sight, self.distance.value, progress
        )
        return replace(
            self, level=self.level - 1, who=who, state=state, depth=depth, sight=sight, halved_state=state
        )
