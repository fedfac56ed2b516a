"""One measurement in a process of its own, called by ``run.py``; prints one JSON object.

task.py scene NAME SIZE … FILE    make a scene and keep it
task.py block FILE BLOCK          write a kept image block as the program of Ceres reads it
task.py gkf FILE GKF              write a kept network as gama-local reads it
task.py compare FILE RESULT       compare a result of gama-local with what mor adjusts
task.py project FILE FOLDER KIND  write a kept scene as a project folder with csv or parquet tables
task.py kernel FILE               time the kernel
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def main(what: str, *arguments: str) -> None:
    """Do one of the tasks."""
    import scenes

    if what == "scene":
        name, *sizes, file = arguments
        scenes.keep(scenes.make(name, tuple(map(int, sizes))), Path(file))
        return
    scene = scenes.kept(Path(arguments[0]))
    if what == "block":
        from peers import write_block

        write_block(scene, Path(arguments[1]))
    elif what == "gkf":
        from gama import write_gkf

        write_gkf(scene, Path(arguments[1]))
    elif what == "compare":
        from gama import compared

        print(json.dumps(compared(scene, Path(arguments[1]))))
    elif what == "project":
        from folders import write_project

        write_project(scene, Path(arguments[1]), arguments[2])
    elif what == "kernel":
        from kernel import time_kernel

        print(json.dumps(time_kernel(scene)))
    else:
        sys.exit(f"{what}: no such task")


if __name__ == "__main__":
    main(*sys.argv[1:])
