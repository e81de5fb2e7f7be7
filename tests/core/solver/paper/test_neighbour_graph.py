import numpy as np
from perfanim.core.solver.paper.neighbour_graph import build_graph


def wandering(frames, seed=0, step=0.01, clips=4):
    """Clips of poses (F, 84) that wander slowly within three directions, and the clip of each frame."""
    generator = np.random.default_rng(seed)
    directions = generator.normal(scale=0.4, size=(3, 84))
    path = np.cumsum(generator.normal(scale=step, size=(frames, 3)), axis=0) % 1.0
    return (np.abs(path - 0.5) @ directions).astype(np.float32), np.arange(frames) * clips // frames


def test_number_of_neighbours_is_bounded():
    poses, clips = wandering(3000, step=0.05)
    graph = build_graph(poses, clips, most=10)
    counts = np.sum(graph.neighbours[:, 2:] >= 0, axis=1)
    assert graph.neighbours.shape == (3000, 10)
    assert counts.min() >= 8
    for frame in (0, 700, 2999):
        kept = graph.neighbours[frame][graph.neighbours[frame] >= 0]
        assert len(set(kept)) == len(kept)
        assert frame not in kept


def test_clustered_graph_holds_nearly_the_closest_frames():
    poses, clips = wandering(12_000, step=0.02)
    graph = build_graph(poses, clips, most=18)
    assert graph.clusters.max() + 1 == len(np.unique(graph.clusters)) > 100
    closer = []
    for frame in range(0, 12_000, 400):
        distances = np.linalg.norm(poses - poses[frame], axis=1)
        distances[max(0, frame - 1) : frame + 2] = np.inf
        passes = (distances[1:-1] <= distances[:-2]) & (distances[1:-1] < distances[2:])
        best = np.sort(distances[1:-1][passes])[:8]
        mine = np.sort(distances[graph.neighbours[frame][2:]])
        closer.append(np.mean(mine[:8]) / np.mean(best))
    assert np.mean(closer) < 1.5  # neighbours beyond the clusters beside a frame's own are not looked for


def test_clips_are_not_joined():
    poses, clips = wandering(40, clips=2)
    graph = build_graph(poses, clips, most=2)
    assert graph.neighbours[19].tolist() == [18, -1]
    assert graph.neighbours[20].tolist() == [-1, 21]
