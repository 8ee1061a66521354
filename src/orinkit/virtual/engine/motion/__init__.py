"""Motion of the virtual robot: time laws, paths, planning within the model's limits, and execution cycle by cycle.

``profile`` says when a motion is how far along its path; ``course`` is the way of the tool, ``path`` that of the joints;
``plan`` makes a :class:`~orinkit.virtual.engine.motion.planner.Motion` of them, and
:class:`~orinkit.virtual.engine.motion.queue.MotionQueue` carries motions out. Nothing here reads a clock or has a thread:
everything is a function of the number of servo cycles.
"""
