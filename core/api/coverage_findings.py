"""What the markers of a take cover, and findings about limbs and labels that they leave open."""

from collections.abc import Sequence
from dataclasses import replace

from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..session.limb_coverage import coverage_text, doubted, open_limbs
from ..session.solved_take import SolvedTake
from ..session.verdict import Reason, ReasonKind
from ..subjects.contradictions import contradicted_bones


def with_coverage(solved: SolvedTake, take: MarkerTake, subject: Subject, used: MarkerSet) -> tuple[SolvedTake, str]:
    """Return the take with findings about its limbs and labels, and the marker coverage in words.

    Limbs without markers are doubtful, and lower the confidence.
    """
    shown = [name for name, visible in zip(take.names, take.visible.T, strict=True) if visible.any()]
    unused = [i for i, name in enumerate(take.names) if name in shown and name not in used.names]
    lacking = open_limbs(subject.marker_set, [name for name in shown if name in used.names])
    known = [marker.name for marker in used.markers if marker.name in shown and not marker.placed]
    inferred = [limb for limb in open_limbs(used, known) if limb not in lacking]
    text = "the labels were recognised from the motion, but not clearly: check them"
    findings = [Reason(ReasonKind.LABELS, text)] if take.is_guessed else []
    if text := contradicted_bones(solved.poses_of(), replace(subject, marker_set=used)):
        findings.append(Reason(ReasonKind.LIMB, text))
    if lacking:
        guessed = "its pose is guessed" if len(lacking) == 1 else "their poses are guessed"
        findings.append(Reason(ReasonKind.LIMB, f"no marker determines {_listed(lacking)}: {guessed}"))
    if inferred:
        text = f"only markers placed from the motion determine {_listed(inferred)}: check the labels"
        findings.append(Reason(ReasonKind.LIMB, text))
    poses = tuple(
        replace(pose, performers=tuple(doubted(each, lacking) for each in pose.performers)) for pose in solved.poses
    )
    all_findings, unused_m = (*solved.findings, *findings), take.positions_m[:, unused]
    solved = replace(solved, poses=poses, findings=all_findings, unused_m=unused_m)
    return solved, coverage_text(used, shown, lacking)


def _listed(limbs: Sequence[str]) -> str:
    return ", ".join(f"the {limb}" for limb in limbs)
