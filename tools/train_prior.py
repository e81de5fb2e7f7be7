"""Train the learned motion prior, which the solver multiplies with its own prior.

It reads poses from built motion databases, plays them on random bodies with random marker sets, and writes a network's
weights. Needs the extra `prior`.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.database.store import open_database
from perfanim.core.solver.motion_prior import VERSION, WEIGHTS, open_network
from perfanim.core.system.files import atomic_path
from prior_training.motion import read_recordings
from prior_training.network import LEAST_SCALE, PART_OF_JOINT, Scaling, first_parameters, residuals, scaling_of, train
from prior_training.performers import PerformerMaker
from prior_training.windows import LAGS_S, WindowMaker

_STEPS = 12_000
_BATCHES = 60  # number of batches used to measure the errors on unseen people
_LEAST_EIGENVALUE = 1e-3  # smallest eigenvalue of the correlation of the errors
_OUTLIER = 4.0  # standard deviations beyond which errors are clipped
_LEAST_SIGMA_RAD, _LEAST_SIGMA_M = 0.02, 0.003
_OPEN_SIGMA_RAD = 0.2  # for entries of the pose that hardly vary in the recordings
_PLACED = 6  # number of outputs for the root


def main() -> None:
    """Train and write the network."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--database", type=Path, nargs="+", required=True, help="built databases (.pfdb)")
    parser.add_argument("--out", type=Path, required=True, help="file to write (.npz)")
    subjects: dict[str, Any] = {"nargs": "*", "default": [], "metavar": "SUBJECT"}
    parser.add_argument("--without", **subjects, help="subjects that are not used at all")
    parser.add_argument("--unseen", **subjects, help="subjects that the errors are taken from")
    parser.add_argument("--further", type=Path, help="prior to train further; its errors on unseen people are kept")
    parser.add_argument("--steps", type=int, default=_STEPS)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    if bool(args.unseen) == bool(args.further):
        parser.error("give either --unseen or --further")
    databases = [open_database(path) for path in args.database]
    everyone = {clip.subject for database in databases for clip in database.clips}
    earlier = open_network(args.further) if args.further else None
    used = everyone - {*args.without, *args.unseen}
    recordings = read_recordings(databases, used, earlier.mean_rotations if earlier else None)
    _say(f"{len(recordings.poses)} frames of {len(recordings.subjects)} subjects")
    makers = PerformerMaker(recordings.skeletons)
    windows = WindowMaker(recordings, makers)
    generator = np.random.default_rng(args.seed)
    scaling = Scaling(earlier.bones, earlier.outputs.astype(np.float32)) if earlier else scaling_of(windows, generator)
    first = {name: getattr(earlier, name) for name in WEIGHTS} if earlier else first_parameters(generator)
    parameters = train(windows, scaling, first, generator, args.steps, _say)
    if earlier is None:
        unseen = WindowMaker(read_recordings(databases, set(args.unseen), recordings.mean_rotations), makers)
        errors, sigmas = residuals(parameters, unseen, scaling, np.random.default_rng(args.seed), _BATCHES)
        error_model = _error_model(errors, sigmas, scaling.outputs[1])
        rms_deg = np.degrees(np.sqrt(np.mean(errors[:, _PLACED:] ** 2)))
        _say(f"unseen people: {rms_deg:.2f} degrees RMS of an entry of the pose")
    else:
        error_model = {"correlation": earlier.correlation, "spread": earlier.spread}
    facts = {
        "version": VERSION,
        "subjects": list(recordings.subjects),
        "frames": len(recordings.poses),
        "steps": args.steps,
        "seed": args.seed,
        "source": "CMU Graphics Lab Motion Capture Database (mocap.cs.cmu.edu)",
    }
    arrays = {name: array.astype(np.float16) for name, array in parameters.items()}
    arrays |= {name: array.astype(np.float32) for name, array in error_model.items()}
    arrays |= {"bones": scaling.bones, "outputs": scaling.outputs, "mean_rotations": recordings.mean_rotations}
    arrays |= {"lags_s": np.array(LAGS_S), "part_of_joint": PART_OF_JOINT, "facts": np.array(json.dumps(facts))}
    args.out.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(args.out) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **arrays)
    _say(f"{args.out}: {args.out.stat().st_size} bytes")


def _error_model(errors: Any, sigmas: Any, scale: Any) -> dict[str, Any]:
    """Return how far the errors exceed the sigmas ("spread"), and how they are correlated ("correlation").

    Entries that hardly vary in the recordings get a wide sigma, because they may vary elsewhere.
    """
    constant = scale <= LEAST_SCALE
    ratio = np.where(constant, 0.0, errors / sigmas)
    spread = np.sqrt(np.mean(ratio**2, axis=0))
    ratio = np.clip(ratio / np.where(constant, 1.0, spread), -_OUTLIER, _OUTLIER)
    correlation = np.corrcoef(ratio.T + 1e-9 * np.random.default_rng(0).normal(size=ratio.T.shape))
    correlation[constant] = correlation[:, constant] = 0.0
    correlation[constant, constant] = 1.0
    values, vectors = np.linalg.eigh(correlation)
    correlation = (vectors * np.maximum(values, _LEAST_EIGENVALUE)) @ vectors.T
    size = np.sqrt(np.diag(correlation))
    least = np.where(np.arange(len(scale)) < _PLACED, _LEAST_SIGMA_M, _LEAST_SIGMA_RAD)
    least[:3] = _LEAST_SIGMA_RAD
    spread = np.array((spread, np.where(constant, _OPEN_SIGMA_RAD, least)))
    return {"correlation": correlation / np.outer(size, size), "spread": spread}


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
