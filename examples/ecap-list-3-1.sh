#!/bin/sh
# List 3-1 of the RC8 document, variables, by curl alone.  RC8 仕様書 List 3-1 (変数アクセス) を curl だけで実行する
#
#   orinkit serve rc8 --http 127.0.0.1:8080 &
#   sh examples/ecap-list-3-1.sh http://127.0.0.1:8080
set -eu
. "$(dirname "$0")/ecap.sh"

call 1 ""                                   # Service_Start
call 3 "" CaoProv.DENSO.VRC localhost ""    # Controller_Connect
controller=$value
call 9 "$controller" IO150 ""               # Controller_GetVariable
variable=$value
call 101 "$variable"                        # Variable_GetValue
call 102 "$variable" 3,-1                   # Variable_PutValue: VT_I4 -1
call 101 "$variable"
call 111 "$variable"                        # Variable_Release
call 4 "$controller"                        # Controller_Disconnect
call 2                                      # Service_Stop
