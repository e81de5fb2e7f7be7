"""What a take's outputs depend on, and what they do not."""

import shutil
from dataclasses import replace

from perfanim.core.cli.batch.content_hash import ContentDigests, take_digest
from perfanim.core.cli.batch.plan import TakePlan
from perfanim.core.database.store import open_database
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings


def digest(take):
    return take_digest(take, ContentDigests())


def test_content_and_settings_count_but_not_places(tmp_path):
    for folder in ("here", "there"):
        (tmp_path / folder / "images").mkdir(parents=True)
        for name in ("walk.c3d", "all.pfdb", "anna.toml", "images/1.png", "images/2.png"):
            (tmp_path / folder / name).write_text(name)

    def take(folder, **options):
        place = tmp_path / folder
        files = {"database": str(place / "all.pfdb"), "subject": str(place / "anna.toml")}
        return TakePlan("walk", "walk.c3d", str(place / "walk.c3d"), files | options)

    here = digest(take("here"))
    assert digest(take("there")) == here
    assert digest(replace(take("here"), source="other words")) == here
    different = [digest(take("here", method="lwr")), digest(replace(take("here"), name="run"))]
    for name in ("walk.c3d", "all.pfdb", "anna.toml"):
        (tmp_path / "there" / name).write_text("other")
        different.append(digest(take("there")))
    (tmp_path / "there" / "walk.c3d").unlink()
    different.append(digest(take("there")))

    def filmed(pattern):
        left = str(tmp_path / "here" / "images" / pattern)
        return TakePlan("walk", "walk", "", {"left": left, "camera": [f"back={left}"]})

    all_images = digest(filmed("*.png"))
    assert digest(filmed("")) == all_images
    different += [all_images, digest(filmed("1*"))]
    (tmp_path / "here" / "images" / "2.png").write_text("other")
    different.append(digest(filmed("*.png")))
    assert len({here, *different}) == len(different) + 1


def test_the_database_of_a_recorded_take_counts(truth, subject, database, tmp_path):
    """It is not in the plan: the take tells it. A damaged take tells none, and has a digest all the same."""
    markers = simulate_markers(truth, subject)[0]
    other = tmp_path / "other.pfdb"
    shutil.copyfile(database.path, other)
    take = tmp_path / "walk.perftake"
    settings = SolveSettings(method="nearest")
    solve_take(markers, subject, open_database(other), settings, lambda fraction, text: None).save(take)
    plan = TakePlan("walk", "walk.perftake", str(take))
    before = digest(plan)
    with other.open("ab") as stream:
        stream.write(b"more")
    assert digest(plan) != before
    take.write_bytes(b"no take")
    assert digest(plan) not in (before, "")
