"""
Publish to ROS 2
================

``tacstrip live --ros2`` publishes outlines and readings without ROS; here a reader in another process, through Cyclone
DDS. Without it (``make ros2`` in a checkout, else ``pip install 'tacstrip[ros2]'``) an earlier run's outline is shown.
With ROS: ``ros2 topic echo``.
"""

import subprocess
from importlib.util import find_spec

import matplotlib.pyplot as plt

DOMAIN = "87"
COMMAND = ["tacstrip", "live", "--simulate", "--no-view", "--ros2", "--ros-domain", DOMAIN, "--seconds", "4"]
LOOPBACK = """<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
</General><Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
<Peers><Peer address="localhost"/></Peers></Discovery></Domain></CycloneDDS>"""

seen = [[21.96, 37.84], [62.13, 22.23], [79.92, 55.07], [45.11, 76.07]]  # of an earlier run
if find_spec("cyclonedds"):
    from cyclonedds import domain, idl, sub, topic
    from cyclonedds.idl.types import float32, int32, sequence, uint32

    struct, msg = idl.make_idl_struct, "geometry_msgs.msg.dds_"
    time = struct("Time", "builtin_interfaces.msg.dds_.Time_", {"sec": int32, "nanosec": uint32})
    header = struct("Header", "std_msgs.msg.dds_.Header_", {"stamp": time, "frame_id": str})
    point = struct("Point32", f"{msg}.Point32_", dict.fromkeys("xyz", float32))
    polygon = struct("Polygon", f"{msg}.Polygon_", {"points": sequence[point]})
    stamped = struct("PolygonStamped", f"{msg}.PolygonStamped_", {"header": header, "polygon": polygon})
    with subprocess.Popen(COMMAND):
        held, here = domain.Domain(int(DOMAIN), LOOPBACK), domain.DomainParticipant(int(DOMAIN))
        outlines = sub.DataReader(here, topic.Topic(here, "rt/tacstrip/object_0/polygon", stamped))
        seen = [[1e3 * p.x, 1e3 * p.y] for p in next(outlines.take_iter(timeout=60 * 10**9)).polygon.points]
figure, axes = plt.subplots(figsize=(5, 4.6), layout="constrained")
axes.fill(*zip(*seen, strict=True), fill=False)
axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]", title="/tacstrip/object_0/polygon")
