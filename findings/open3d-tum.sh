#!/usr/bin/env bash
# A camera trajectory that Open3D writes as TUM and reads again: as many poses, at times that mean something.
# Open3D needs the system's libusb-1.0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" -q --disable-pip-version-check install open3d==0.20.0 evo==1.38.1 || exit 2
cd "$folder" && "$folder/venv/bin/python" - <<'PYTHON'
import numpy as np

try:
    import open3d as o3d
except ImportError as error:
    print(error)
    raise SystemExit(2)
from evo.tools import file_interface

poses = []
for k in range(3):
    pose = o3d.camera.PinholeCameraParameters()
    extrinsic = np.eye(4)
    extrinsic[0, 3] = -k  # the camera stands at x = k
    pose.extrinsic, pose.intrinsic = extrinsic, o3d.camera.PinholeCameraIntrinsic(640, 480, 500.0, 500.0, 319.5, 239.5)
    poses.append(pose)
written = o3d.camera.PinholeCameraTrajectory()
written.parameters = poses
o3d.io.write_pinhole_camera_trajectory("path.txt", written)
first = open("path.txt").readline().rstrip()
read = o3d.io.read_pinhole_camera_trajectory("path.txt")
by_evo = file_interface.read_tum_trajectory_file("path.txt")
print(f"Open3D {o3d.__version__}: first line {first!r}")
print(f"3 poses written; read by Open3D {len(read.parameters)}, by evo {by_evo.num_poses}, the first at x = {by_evo.positions_xyz[0, 0]:g}")
raise SystemExit(not (first.startswith("#") and "<qw>0 " in first and len(read.parameters) == 2 and by_evo.num_poses == 2))
PYTHON
