#!/usr/bin/env python3
"""Reads track.csv of `turncal navigate`: prints what each branch drifted, and draws it where matplotlib is installed.

    python3 docs/examples/read_track.py FOLDER/track.csv [PLOT.png]
"""
import sys

import numpy as np

track = np.genfromtxt(sys.argv[1], delimiter=",", names=True)
branches = [track[track["branch"] == b] for b in np.unique(track["branch"])]
for number, rows in enumerate(branches, 1):
    hours = (rows["time_s"] - rows["time_s"][0]) / 3600
    miles = np.hypot(rows["north_m"], rows["east_m"]) / 1852
    rate = np.sum(hours * miles) / np.sum(hours**2)  # straight line through the origin
    print(f"branch {number}: {hours[-1]:.3f} h, {miles[-1]:.3f} NM from where it stands, {rate:.3f} NM/h")

if len(sys.argv) > 2:
    try:
        import matplotlib
    except ImportError:
        sys.exit("matplotlib is not installed: no plot (Debian: python3-matplotlib)")
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (speed, distance) = plt.subplots(2, 1, sharex=True, figsize=(8, 6))
    for rows in branches:
        minutes = (rows["time_s"] - rows["time_s"][0]) / 60
        speed.plot(minutes, rows["velocity_north_mps"])
        distance.plot(minutes, np.hypot(rows["north_m"], rows["east_m"]) / 1852)
    speed.set_ylabel("velocity north, m/s")
    distance.set_ylabel("distance, nm")
    distance.set_xlabel("minutes of free navigation")
    figure.savefig(sys.argv[2])
