"""
Watch in Foxglove
=================

``tacstrip live --foxglove`` serves Foxglove and Lichtblick, and whatever else speaks their protocol: here a client of
ten lines. Without it (``pip install 'tacstrip[foxglove]'``) the picture shows what an earlier run read, thinned.
"""

import asyncio
import json
import subprocess
from importlib.util import find_spec

import aiohttp
import matplotlib.pyplot as plt

COMMAND = ["tacstrip", "live", "--simulate", "--no-view", "--foxglove", "0", "--seconds", "2"]


async def readings(url):
    """Subscribe to the readings; keep what comes until the stream ends."""
    async with aiohttp.ClientSession() as web, web.ws_connect(url, protocols=["foxglove.sdk.v1"]) as viewer:
        async for message in viewer:
            if message.type == aiohttp.WSMsgType.BINARY:  # 13 bytes: kind, subscription, time [ns]
                seen.update(json.loads(message.data[13:]))
                continue
            for channel in json.loads(message.data).get("channels", ()):
                if channel["topic"] == "/tacstrip/signatures":
                    wanted = [{"id": 1, "channelId": channel["id"]}]
                    await viewer.send_json({"op": "subscribe", "subscriptions": wanted})


seen = {"x_mm": [23, 33, 43, 53, 63, 73], "kh": [0.385, 0.51, 0.648, 0.632, 0.56, 0.554]}
seen["kl"] = [0.377, 0.376, 0.382, 0.333, 0.3, 0.463]
if find_spec("foxglove"):
    with subprocess.Popen(COMMAND, stderr=subprocess.PIPE, text=True) as live:
        asyncio.run(readings(next(w for line in live.stderr for w in line.split() if w.startswith("ws://"))))
figure, axes = plt.subplots(figsize=(6.5, 3.6), layout="constrained")
axes.plot(seen["x_mm"], seen["kh"], "o", seen["x_mm"], seen["kl"], "s")
axes.set(xlabel="x [mm]", ylabel="k_h (dots), k_l (squares)", title="/tacstrip/signatures")
