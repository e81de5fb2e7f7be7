"""Description of the simulated performer, in a module that is cheap to import."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar

from ...errors import SettingsError
from ...system.schema import About, Schema

_BODY_M = About("body height; by default the shipped performer's", "m", 0.5, 3.0)


@dataclass(frozen=True)
class Partner:
    """Another simulated performer; by default like the first one, but mirrored."""

    is_closed: ClassVar[bool] = True
    behaviour: Annotated[str, About('"demo" or a behaviour')] = ""
    mirrored: Annotated[
        bool | None, About("whether left and right are exchanged; by default the opposite of the first")
    ] = None
    height_m: Annotated[float | None, _BODY_M] = None
    marker_set: Annotated[str, About("name of a shipped marker set, or a file")] = ""


@dataclass(frozen=True)
class SimulatedPerformer:
    """The simulated performer in front of simulated cameras.

    Partners stand to the right of the first performer as the cameras see them; a single performer stands in the middle.
    """

    is_closed: ClassVar[bool] = True
    kind: Annotated[str, About("kind of source", choices=("simulated",), optional=False)] = "simulated"
    behaviour: Annotated[str, About('"demo", or a behaviour or its beginning')] = "demo"
    seconds: Annotated[float | None, About("duration of the behaviour; by default as shipped", "s")] = None
    mirrored: Annotated[bool, About("whether left and right are exchanged")] = False
    height_m: Annotated[float | None, _BODY_M] = None
    marker_set: Annotated[str, About("name of a shipped marker set, or a file, with offsets")] = "boxing"
    cameras: Annotated[int, About("number of cameras", "", 1, 8)] = 2
    fps: Annotated[float, About("frame rate", "frames per second", 0.1, 1000.0)] = 60.0
    live: Annotated[bool, About("whether frames come in real time, and late ones are dropped")] = False
    at_once: Annotated[bool, About("whether the performer moves at once, without a T pose")] = False
    loop: Annotated[bool | None, About("whether the performance repeats; by default if it is live")] = None
    poses: Annotated[tuple[str, ...], About("calibration poses held before the behaviour")] = ()
    held_s: Annotated[float, About("duration of each pose", "s")] = 2.0
    prop: Annotated[str, About("name or file of a prop in the right hand")] = ""
    partners: Annotated[tuple[Partner, ...], About("further performers, 7 at most")] = ()
    studio: Annotated[Mapping[str, Any], About("settings of the images, see `StudioSettings`")] = field(
        default_factory=dict
    )

    @property
    def is_live(self) -> bool:
        """Whether the source cannot be paused; the simulated one always can."""
        return False

    @property
    def is_repeatable(self) -> bool:
        """Whether the images can be read again."""
        return not self.live

    def partner(self, partner: Partner) -> "SimulatedPerformer":
        """Return the description of a partner as a performer of its own."""
        return replace(
            self,
            behaviour=partner.behaviour or self.behaviour,
            mirrored=not self.mirrored if partner.mirrored is None else partner.mirrored,
            height_m=self.height_m if partner.height_m is None else partner.height_m,
            marker_set=partner.marker_set or self.marker_set,
        )


SIMULATED = Schema(
    SimulatedPerformer,
    "Simulated performer",
    "Image source for practice and tests.",
    SettingsError,
    "choose the source again",
    closed=True,
)
