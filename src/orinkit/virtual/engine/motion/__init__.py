"""Motion of the virtual robot: motion profiles, paths, planning within the model's limits, and execution in cycles.

The module ``profile`` defines the progress of a motion over time, ``cartesian_path`` the path of the tool, and
``joint_path`` the path of the joints. ``planner`` combines progress and path into a
:class:`~orinkit.virtual.engine.motion.planner.Motion`, and :class:`~orinkit.virtual.engine.motion.queue.MotionQueue`
executes this motion. Nothing here reads a clock or starts a thread: everything is a function of the number of servo
cycles.
"""
