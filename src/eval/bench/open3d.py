"""Registers an RGB-D recording with Open3D, as `ostra bench` starts it.

The argument is a JSON object: images and depth (folders), names (of the images, in order), units_per_metre (of depth),
camera (PINHOLE parameters) and work (empty folder). The cameras are written to work/cameras. The last line of the output
is a JSON object of what it took.

Neighbouring frames are registered by RGB-D odometry. Every fifth frame is also registered with the other fifth ones that
the neighbours put near it. A pose graph combines them. The limits of depth are those of Open3D's own reconstruction
system, which has fragments and ICP besides. `timed` and `peak_memory_bytes` are in timing.py, which comes before this.
"""

import json
import sys
from pathlib import Path

import numpy
import open3d
from open3d.pipelines import odometry, registration

FARTHEST_M = 3.0
DEPTH_DIFFERENCE_M = 0.07
KEYFRAME_STEP = 5
# Frames farther apart than this, in metres and in degrees, are not compared.
NEAR_M, NEAR_DEG = 1.5, 60.0


def read_frames(request):
    images, depths = Path(request["images"]), Path(request["depth"])
    depth_of = {path.stem: path for path in depths.iterdir()}
    frames = []
    for name in request["names"]:
        color = open3d.io.read_image(str(images / name))
        depth = open3d.io.read_image(str(depth_of[Path(name).stem]))
        frames.append(
            open3d.geometry.RGBDImage.create_from_color_and_depth(
                color, depth, depth_scale=request["units_per_metre"], depth_trunc=FARTHEST_M
            )
        )
    return frames


class Recording:
    """Frames with the poses and relations found so far."""

    def __init__(self, frames, intrinsics):
        self.frames, self.intrinsics = frames, intrinsics
        self.poses = [numpy.eye(4)]
        self.edges = []

    def relation(self, first, second, guess):
        option = odometry.OdometryOption(depth_diff_max=DEPTH_DIFFERENCE_M, depth_max=FARTHEST_M)
        found, motion, information = odometry.compute_rgbd_odometry(
            self.frames[first],
            self.frames[second],
            self.intrinsics,
            guess,
            odometry.RGBDOdometryJacobianFromHybridTerm(),
            option,
        )
        if found:
            is_loop = second != first + 1
            self.edges.append(registration.PoseGraphEdge(first, second, motion, information, uncertain=is_loop))
        return motion if found else numpy.eye(4)

    def chain(self):
        for first in range(len(self.frames) - 1):
            motion = self.relation(first, first + 1, numpy.eye(4))
            self.poses.append(self.poses[first] @ numpy.linalg.inv(motion))

    def close_loops(self):
        keyframes = range(0, len(self.frames), KEYFRAME_STEP)
        for first in keyframes:
            for second in keyframes:
                guess = numpy.linalg.inv(self.poses[second]) @ self.poses[first]
                if first < second and is_near(guess):
                    self.relation(first, second, guess)

    def optimise(self):
        """Optimises the poses of the largest group of frames that relations connect, and returns these frames."""
        frames = self.connected()
        place = {frame: number for number, frame in enumerate(frames)}
        graph = registration.PoseGraph()
        graph.nodes.extend([registration.PoseGraphNode(self.poses[frame]) for frame in frames])
        for edge in self.edges:
            if edge.source_node_id in place:
                edge.source_node_id = place[edge.source_node_id]
                edge.target_node_id = place[edge.target_node_id]
                graph.edges.append(edge)
        option = registration.GlobalOptimizationOption(
            max_correspondence_distance=DEPTH_DIFFERENCE_M,
            edge_prune_threshold=0.25,
            preference_loop_closure=0.1,
            reference_node=0,
        )
        registration.global_optimization(
            graph,
            registration.GlobalOptimizationLevenbergMarquardt(),
            registration.GlobalOptimizationConvergenceCriteria(),
            option,
        )
        for frame, node in zip(frames, graph.nodes):
            self.poses[frame] = node.pose
        # Loops that contradict the others were removed, and with them perhaps the only relations of a frame.
        self.edges = list(graph.edges)
        for edge in self.edges:
            edge.source_node_id = frames[edge.source_node_id]
            edge.target_node_id = frames[edge.target_node_id]
        return self.connected()

    def connected(self):
        """Returns the frames of the largest group that relations connect."""
        group = list(range(len(self.frames)))

        def root(frame):
            while group[frame] != frame:
                frame = group[frame]
            return frame

        for edge in self.edges:
            group[root(edge.source_node_id)] = root(edge.target_node_id)
        roots = [root(frame) for frame in range(len(self.frames))]
        largest = max(set(roots), key=roots.count)
        return [frame for frame, its_root in enumerate(roots) if its_root == largest]


def is_near(motion):
    cosine = (numpy.trace(motion[:3, :3]) - 1) / 2
    degrees = numpy.degrees(numpy.arccos(numpy.clip(cosine, -1, 1)))
    return numpy.linalg.norm(motion[:3, 3]) <= NEAR_M and degrees <= NEAR_DEG


def quaternion(rotation):
    """Returns w, x, y, z of a rotation matrix, by the eigenvector of its largest eigenvalue."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    matrix = numpy.array(
        [
            [a - e - i, d + b, g + c, h - f],
            [d + b, e - a - i, h + f, c - g],
            [g + c, h + f, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    x, y, z, w = numpy.linalg.eigh(matrix)[1][:, -1]
    return w, x, y, z


def write_cameras(folder, size, camera, images):
    """Writes a COLMAP text model; `images` holds a name and a pose (world from camera) each."""
    folder.mkdir()
    numbers = [*size, *camera]
    (folder / "cameras.txt").write_text(f"1 PINHOLE {' '.join(map(str, numbers))}\n")
    lines = []
    for number, (name, pose) in enumerate(images, start=1):
        inverse = numpy.linalg.inv(pose)
        values = [*quaternion(inverse[:3, :3]), *inverse[:3, 3]]
        lines.append(f"{number} {' '.join(map(str, values))} 1 {name}\n\n")
    (folder / "images.txt").write_text("".join(lines))
    (folder / "points3D.txt").write_text("")


def main():
    request, steps = json.loads(sys.argv[1]), []
    frames = timed(steps, "Read images", lambda: read_frames(request))
    height, width = numpy.asarray(frames[0].color).shape[:2]
    fx, fy, cx, cy = request["camera"]
    # Open3D counts from the centre of the first pixel, the request from its corner.
    intrinsics = open3d.camera.PinholeCameraIntrinsic(width, height, fx, fy, cx - 0.5, cy - 0.5)
    recording = Recording(frames, intrinsics)
    timed(steps, "Register neighbours", recording.chain)
    timed(steps, "Find loops", recording.close_loops)
    placed = timed(steps, "Optimise poses", recording.optimise)
    images = [(request["names"][frame], recording.poses[frame]) for frame in placed]
    write_cameras(Path(request["work"]) / "cameras", (width, height), request["camera"], images)
    result = {"steps": steps, "placed": len(placed), "peak_memory_bytes": peak_memory_bytes()}
    print()
    print(json.dumps(result), flush=True)


main()
