"""The hands of the virtual controller: finger grippers and vacuum hands that work in the controller's 8 ms cycles.

* :mod:`~orinkit.virtual.rc8.hand.fingers`: two parallel fingers, and the workpiece that they meet
* :mod:`~orinkit.virtual.rc8.hand.vacuum`: a vacuum pump and its cups
* :mod:`~orinkit.virtual.rc8.hand.cobotta`: the hand of a COBOTTA (``HandMoveA`` ...)
* :mod:`~orinkit.virtual.rc8.hand.gripper`: an electric gripper on an extension board (``Hand0`` to ``Hand7``)
* :mod:`~orinkit.virtual.rc8.hand.onrobot`: 2FG7 and VGC10 of OnRobot on a COBOTTA PRO (``TwofgGrip`` ...)
* :mod:`~orinkit.virtual.rc8.hand.hands`: all hands of a controller
"""
