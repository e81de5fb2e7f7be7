"""Set-up of a capture: cameras, performers, props, database and settings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ..database.store import Database, identity
from ..formats.take_file.take_setup import TakeSetup
from ..geometry.camera import CameraRig
from ..markers.prop import Prop
from ..markers.subject import Subject
from ..solver.settings import SolveSettings
from .multi_target_session import MultiTargetSession
from .session import Session

SessionMaker = Callable[[Subject, Database, CameraRig | None, SolveSettings], Session]


@dataclass(frozen=True)
class CaptureSetup:
    """Set-up of a capture; a `TakeSetup` holds the same as tables."""

    rig: CameraRig | None  # None for markers without cameras
    performers: tuple[Subject, ...]  # at least one, each with the markers that are worn
    props: tuple[Prop, ...]
    database: Database
    settings: SolveSettings

    @staticmethod
    def from_tables(tables: TakeSetup, database: Database, settings: SolveSettings) -> "CaptureSetup":
        """Return the set-up from a take's tables; TakeError if they are damaged."""
        return CaptureSetup(tables.camera_rig(), tables.subjects(), tables.carried_props(), database, settings)

    def tables(self, capture: Mapping[str, Any], settings: Mapping[str, Any] | None = None) -> TakeSetup:
        """Return the tables for a new take; `settings` are by default those that differ from the solver's defaults."""
        given = self.settings.table() if settings is None else settings
        return TakeSetup.of(self.rig, self.performers, given, identity(self.database), capture, self.props)

    def make_session(self, make: SessionMaker = Session) -> MultiTargetSession:
        """Return a new session for all targets; errors are those of `MultiTargetSession`.

        Args:
            make: Creates the session of a single performer (see `SessionCache`).
        """
        one = make if len(self.performers) == 1 else Session
        sessions = [one(subject, self.database, self.rig, self.settings) for subject in self.performers]
        return MultiTargetSession(sessions, self.props)
