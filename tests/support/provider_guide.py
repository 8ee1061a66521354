"""Entries of the provider guide of the RC8, and which tests show them.

A test names the entries that it shows: ``@pytest.mark.guide("5.2.11.3 KillAll")``. ``tests/project/test_guide.py``
checks the names.
"""

from __future__ import annotations

from typing import Final

_TEXT: Final = """\
# General
3.1.3 HRESULT rule
5.2.28 ff. what may be called in slave mode
App. C two calls of one connection at a time
# Connecting, files, properties
5.2.1, 5.2.1.1 name of AddController
5.2.1 options, @IfNotMember, empty name
5.2.2 AddFile @Create
5.2.3 AddRobot
5.2.4 AddTask
5.2.5 AddVariable names
5.2.6 AddExtension
5.2.7 get_Name
5.2.8 get_FileNames
5.2.9 get_TaskNames
5.2.10 get_VariableNames
5.2.12 file AddFile
5.2.15 file get_FileNames
5.2.16 file get_Size
5.2.17 file get_Value
5.2.18 file put_Value
# Controller Execute
5.2.11.1 ClearError
5.2.11.2 GetErrorDescription
5.2.11.3 KillAll
5.2.11.4 KillAllTsr
5.2.11.5 RunAllTsr
5.2.11.6 SuspendAll
5.2.11.7 StepStopAll
5.2.11.8 ContinueStartAll
5.2.11.9 GetErrorLogCount
5.2.11.10 GetErrorLog
5.2.11.11 GetOprLogCount
5.2.11.12 GetOprLog
5.2.11.13 GetPublicValue
5.2.11.14 SetPublicValue
5.2.11.15 SysState
5.2.11.16 SysInfo
# Robot methods
5.2.19 Accelerate
5.2.20 AddVariable
5.2.21 get_VariableNames
5.2.22 Halt
5.2.23 Change
5.2.24 Drive
5.2.25, App. B Move
5.2.26 Rotate
5.2.27 Speed
5.2.34 Variable get_Value
5.2.35 Variable put_Value
# Robot Execute
5.2.28.1 TMul
5.2.28.2 TInv
5.2.28.3 TNorm
5.2.28.4 J2T
5.2.28.5 T2J
5.2.28.6 J2P
5.2.28.7 P2J
5.2.28.8 T2P
5.2.28.9 P2T
5.2.28.10 Dev
5.2.28.11 DevH
5.2.28.12 OutRange
5.2.28.13 MPS
5.2.28.14 RPM
5.2.28.15 DPS
5.2.28.16 CurPos
5.2.28.17 DestPos
5.2.28.18 CurPosEx
5.2.28.19 DestPosEx
5.2.28.20 HighCurPosEx
5.2.28.21 CurJnt
5.2.28.22 DestJnt
5.2.28.23 CurJntEx
5.2.28.24 DestJntEx
5.2.28.25 HighCurJntEx
5.2.28.26 CurTrn
5.2.28.27 DestTrn
5.2.28.28 CurTrnEx
5.2.28.29 DestTrnEx
5.2.28.30 HighCurTrnEx
5.2.28.31 CurFig
5.2.28.32 CurSpd
5.2.28.33 CurAcc
5.2.28.34 CurDec
5.2.28.35 CurJSpd
5.2.28.36 CurJAcc
5.2.28.37 CurJDec
5.2.28.38 StartLog
5.2.28.39 StopLog
5.2.28.40 ClearLog
5.2.28.41 Motor
5.2.28.42 ExtSpeed
5.2.28.43 TakeArm
5.2.28.44 GiveArm
5.2.28.45 Draw
5.2.28.46 Approach
5.2.28.47 Depart
5.2.28.48 DriveEx
5.2.28.49 DriveAEx
5.2.28.50 RotateH
5.2.28.51 Arrive
5.2.28.52 MotionSkip
5.2.28.53 MotionComplete
5.2.28.54 CurTool
5.2.28.55 GetToolDef
5.2.28.56 SetToolDef
5.2.28.57 CurWork
5.2.28.58 GetWorkDef
5.2.28.59 SetWorkDef
5.2.28.60 WorkAttribute
5.2.28.61 GetAreaDef
5.2.28.62 SetAreaDef
5.2.28.63 SetArea
5.2.28.64 ResetArea
5.2.28.65 AreaSize
5.2.28.66 GetAreaEnabled
5.2.28.67 SetAreaEnabled
5.2.28.68 AddPathPoint
5.2.28.69 ClrPathPoint
5.2.28.70 GetPathPoint
5.2.28.71 LoadPathPoint
5.2.28.72 GetPathPointCount
5.2.28.73 GetRobotTypeName
5.2.28.74 ArchMove
5.2.28.75 CrtMotionAllow
5.2.28.76 EncMotionAllow
5.2.28.77 EncMotionAllowJnt
5.2.28.78 ErAlw
5.2.28.79 ForceCtrl
5.2.28.80 ForceParam
5.2.28.81 ForceValue
5.2.28.82 ForceWaitCondition
5.2.28.83 ForceSensor
5.2.28.84 ForceChangeTable
5.2.28.85 GetSrvData
5.2.28.86 GetSrvJntData
5.2.28.87 GrvCtrl
5.2.28.88 CurLmt
5.2.28.89 Zforce
5.2.28.90 GrvOffset
5.2.28.91 HighPathAccuracy
5.2.28.92 MotionTimeout
5.2.28.93 SingularAvoid
5.2.28.94 SpeedMode
5.2.28.95 PayLoad
5.2.28.96 GenerateNonStopPath
5.2.28.97 RobInfo
5.2.28.98 SetBaseDef
5.2.28.99 SyncTimeStart
5.2.28.100 SyncTimeEnd
5.2.28.101 SyncMoveStart
5.2.28.102 SyncMoveEnd
5.2.28.103 GetBaseDef
5.2.28.104 SetHandIO
5.2.28.105 GetHandIO
5.2.28.106 StartServoLog
5.2.28.107 ClearServoLog
5.2.28.108 StopServoLog
5.2.28.109 GetCtrlLogMaxTime
5.2.28.110 SetCtrlLogMaxTime
5.2.28.111 GetCtrlLogInterval
5.2.28.112 SetCtrlLogInterval
# Task
5.2.29 AddVariable
5.2.30 get_VariableNames
5.2.31 Start
5.2.32 Stop
5.2.33.1 GetStatus
5.2.33.2 GetThreadPriority
5.2.33.3 SetThreadPriority
# Hand
5.2.36.1 Chuck
5.2.36.2 UnChuck
5.2.36.3 Motor
5.2.36.4 Org
5.2.36.5 MoveP
5.2.36.6 MoveA
5.2.36.7 MoveR
5.2.36.8 MoveAH
5.2.36.9 MoveRH
5.2.36.10 MoveH
5.2.36.11 MoveZH
5.2.36.12 Stop
5.2.36.13 CurPos
5.2.36.14 GetPoint
5.2.36.15 get_EmgState
5.2.36.16 get_ZonState
5.2.36.17 get_OrgState
5.2.36.18 get_HoldState
5.2.36.19 get_InposState
5.2.36.20 get_Error
5.2.36.21 get_BusyState
5.2.36.22 get_MotorState
# Variables
5.3.1 I
5.3.1 F
5.3.1 D
5.3.1 V
5.3.1 P
5.3.1 J
5.3.1 T
5.3.1 S
5.3.1 IO
5.3.1 IOB
5.3.1 IOW
5.3.1 IOD
5.3.1 IOF
5.3.1 @VAR_I_LEN
5.3.1 @VAR_F_LEN
5.3.1 @VAR_D_LEN
5.3.1 @VAR_V_LEN
5.3.1 @VAR_J_LEN
5.3.1 @VAR_P_LEN
5.3.1 @VAR_T_LEN
5.3.1 @VAR_S_LEN
5.3.1 @VAR_IO_LEN
5.3.1 @MODE
5.3.1 @LOCK
5.3.1 @TIME
5.3.1 @CURRENT_TIME
5.3.1 @BUSY_STATUS
5.3.1 @TSR_BUSY_STATUS
5.3.1 @NORMAL_STATUS
5.3.1 @ERROR_CODE
5.3.1 @ERROR_CODE_HEX
5.3.1 @ERROR_DESCRIPTION
5.3.1 @EMERGENCY_STOP
5.3.1 @DEADMAN_SW
5.3.1 @AUTO_ENABLE
5.3.1 @MAKER_NAME
5.3.1 @TYPE
5.3.1 @VERSION
5.3.1 @SERIAL_NO
5.3.1 @PROTECTIVE_STOP
5.3.2 robot @CURRENT_POSITION
5.3.2 robot @CURRENT_ANGLE
5.3.2 robot @SERVO_ON
5.3.2 robot @BUSY_STATUS
5.3.2 robot @TYPE_NAME
5.3.2 robot @TYPE
5.3.2 robot @CURRENT_TRANS
5.3.2 robot @CURRENT_TOOL
5.3.2 robot @CURRENT_WORK
5.3.2 robot @SPEED
5.3.2 robot @ACCEL
5.3.2 robot @DECEL
5.3.2 robot @JSPEED
5.3.2 robot @JACCEL
5.3.2 robot @JDECEL
5.3.2 robot @EXTSPEED
5.3.2 robot @EXTACCEL
5.3.2 robot @EXTDECEL
5.3.2 robot @HIGH_CURRENT_POSITION
5.3.2 robot @HIGH_CURRENT_ANGLE
5.3.2 robot @HIGH_CURRENT_TRANS
5.3.2 robot @DEST_ANGLE
5.3.2 robot @DEST_POSITION
5.3.2 robot @DEST_TRANS
5.3.2 robot Tool*
5.3.2 robot Work*
5.3.2 robot Area*
5.3.3 task @STATUS
5.3.3 task @PRIORITY
5.3.3 task @LINE_NO
5.3.3 task @CYCLE_TIME
5.3.3 task @START
5.3.3 task @STOP
5.3.3 task @ELAPSED_TIME
5.3.3 task @STATUS_DETAILS
5.3.4 file @CRC
"""

ENTRIES: Final = tuple(line for line in _TEXT.splitlines() if line and not line.startswith("#"))
"""Sections and names of all entries, in the order of the guide."""

LEFT_OUT: Final[dict[str, str]] = {}
"""Entries that the virtual RC8 does not have, each with its reason; docs/howto/virtual-rc8.md names them, too."""

_REFUSED_IN_SLAVE_MODE: Final = """
    ClearLog StartLog Motor ExtSpeed TakeArm Draw Approach Depart DriveEx DriveAEx RotateH Arrive MotionSkip ArchMove SetToolDef
    SetWorkDef SetAreaDef SetArea ResetArea SetAreaEnabled AddPathPoint ClrPathPoint LoadPathPoint CrtMotionAllow EncMotionAllow
    EncMotionAllowJnt ErAlw ForceCtrl ForceParam ForceWaitCondition ForceSensor ForceChangeTable GrvCtrl CurLmt Zforce GrvOffset
    HighPathAccuracy MotionTimeout SingularAvoid SpeedMode PayLoad
"""
REFUSED_IN_SLAVE_MODE: Final = tuple(_REFUSED_IN_SLAVE_MODE.split())
"""Commands of Robot_Execute of which the guide says that they cannot be used in slave mode."""


def robot_execute_commands() -> list[str]:
    """Return the names of all commands of Robot_Execute in the guide (5.2.28)."""
    return [entry.split()[1] for entry in ENTRIES if entry.startswith("5.2.28.")]


def controller_execute_commands() -> list[str]:
    """Return the names of all commands of Controller_Execute in the guide (5.2.11)."""
    return [entry.split()[1] for entry in ENTRIES if entry.startswith("5.2.11.")]
