"""Motion of the virtual robot: motion profiles, paths, planning within the model's limits, and execution cycle by cycle.

``profile`` defines the progress of a motion over time, ``cartesian_path`` the path of the tool and ``joint_path`` that of
the joints. ``planner`` combines them to a :class:`~orinkit.virtual.engine.motion.planner.Motion`, which
:class:`~orinkit.virtual.engine.motion.queue.MotionQueue` executes. Nothing here reads a clock or starts a thread:
everything is a function of the number of servo cycles.
"""
