"""Databases and sessions shared by many takes."""

from collections import OrderedDict
from pathlib import Path

from ..database.store import Database, open_database
from ..geometry.camera import CameraRig
from ..markers.subject import Subject, subject_tables
from ..solver.settings import SolveSettings
from .session import Session

_SESSIONS_KEPT = 2  # small, because each session holds the markers of all database frames


class SessionCache:
    """Cache of databases by file, and of sessions by performer, database and settings."""

    def __init__(self) -> None:
        self._databases: dict[Path, Database] = {}
        self._sessions: OrderedDict[str, Session] = OrderedDict()

    def database(self, path: Path | str) -> Database:
        """Return the database of a file, which is opened on the first call; errors are those of `open_database`."""
        place = Path(path).resolve()
        if place not in self._databases:
            self._databases[place] = open_database(path)
        return self._databases[place]

    def session(self, subject: Subject, database: Database, rig: CameraRig | None, settings: SolveSettings) -> Session:
        """Return a reset session, valid until the next call.

        A session with cameras is always new, because cameras differ from take to take.
        """
        if rig is not None:
            return Session(subject, database, rig, settings)
        key = repr((subject_tables(subject), database.path.resolve(), settings))
        if key not in self._sessions:
            self._sessions[key] = Session(subject, database, None, settings)
        self._sessions.move_to_end(key)
        if len(self._sessions) > _SESSIONS_KEPT:
            self._sessions.popitem(last=False)
        session = self._sessions[key]
        session.reset()
        return session
