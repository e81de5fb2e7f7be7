"""All that turns the marker frames of one capture into poses: cameras, performers, props, database and settings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ..database.store import Database, identity
from ..formats.take_file.setup import TakeSetup
from ..geometry.camera import CameraRig
from ..markers.prop import Prop
from ..markers.subject import Subject
from ..solver.settings import SolveSettings
from .multi_target_session import MultiTargetSession
from .session import Session

SessionMaker = Callable[[Subject, Database, CameraRig | None, SolveSettings], Session]


@dataclass(frozen=True)
class CaptureSetup:
    """Set-up of a capture; `TakeSetup` is its form in tables.

    Args:
        rig: the cameras, None for markers without any.
        performers: each with the markers worn, at least one.
        props: followed besides.
    """

    rig: CameraRig | None
    performers: tuple[Subject, ...]
    props: tuple[Prop, ...]
    database: Database
    settings: SolveSettings

    @staticmethod
    def from_tables(tables: TakeSetup, database: Database, settings: SolveSettings) -> "CaptureSetup":
        """Return the set-up that a take's tables describe; TakeError when they are damaged."""
        return CaptureSetup(tables.camera_rig(), tables.subjects(), tables.carried_props(), database, settings)

    def tables(self, capture: Mapping[str, Any], settings: Mapping[str, Any] | None = None) -> TakeSetup:
        """Return the tables for a take that begins now.

        Args:
            capture: how the images became marker frames.
            settings: of the solver as they were given, None for those that differ from the defaults.
        """
        given = self.settings.table() if settings is None else settings
        return TakeSetup.of(self.rig, self.performers, given, identity(self.database), capture, self.props)

    def make_session(self, make: SessionMaker = Session) -> MultiTargetSession:
        """Return a session of all performers and props that has seen nothing yet.

        Args:
            make: makes the session of a performer who is alone (see `SessionCache`).

        Raises:
            PropError: two props have patterns that cannot be distinguished.
            SettingsError: several performers before one camera.
        """
        one = make if len(self.performers) == 1 else Session
        sessions = [one(subject, self.database, self.rig, self.settings) for subject in self.performers]
        return MultiTargetSession(sessions, self.props)
