#!/bin/sh
# List 3-3 of the RC8 document, the robot, by curl alone.  RC8 仕様書 List 3-3 (ロボット制御) を curl だけで実行する
#
#   orinkit serve rc8 --http 127.0.0.1:8080 &
#   sh examples/ecap-list-3-3.sh http://127.0.0.1:8080
set -eu
. "$(dirname "$0")/ecap.sh"

call 1 ""                                                   # Service_Start
call 3 "" CaoProv.DENSO.VRC localhost ""                    # Controller_Connect
controller=$value
call 9 "$controller" P1 ""                                  # P1 is taught first: Controller_GetVariable
p1=$value
call 102 "$p1" 8197,330,180,320,180,0,180,5                 # Variable_PutValue: X, Y, Z, RX, RY, RZ, figure
call 7 "$controller" Arm ""                                 # Controller_GetRobot
robot=$value
call 64 "$robot" Takearm "8,"                               # Robot_Execute, an empty VT_BSTR as in the list
call 64 "$robot" ExtSpeed 5,20                              # 20 % of the speed
call 64 "$robot" Motor 8,1                                  # motor on
call 72 "$robot" 1 8,P1 ""                                  # Robot_Move: 1 is PTP
call 64 "$robot" CurPos ""                                  # it is there
call 64 "$robot" Motor 8,0                                  # motor off
call 64 "$robot" Givearm "8,"
call 84 "$robot"                                            # Robot_Release
call 4 "$controller"                                        # Controller_Disconnect
call 2                                                      # Service_Stop
