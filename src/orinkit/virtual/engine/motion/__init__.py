"""Motion of the virtual robot: motion profiles, paths, planning within the model's limits, and execution in cycles.

``profile`` defines the progress of a motion over time, ``cartesian_path`` the path of the tool and ``joint_path`` the
path of the joints. ``planner`` combines them into a :class:`~orinkit.virtual.engine.motion.planner.Motion`, which
:class:`~orinkit.virtual.engine.motion.queue.MotionQueue` executes. Nothing here reads a clock or starts a thread:
everything is a function of the number of servo cycles.
"""
