"""The function table: all functions of CAO, common to b-CAP and e-CAP (RC8 appendix A, e-CAP 3.3).

An entry is a typed signature decorated with :func:`function`. The decorator specifies the id, the name in the
documents, the CAO interface name, the section of the documents, and a description in both languages. If the function
returns a handle, the decorator also specifies the interface of the object and the function that releases the handle.

An argument with a default may be omitted from the packet. If the default is ``None`` and the type is not VARIANT, the
client omits the argument unless the caller gives a value. Encoders, client methods, server dispatch, the
``orinkit functions`` listing and the tests use this table; a new function requires only an entry.

    >>> robot_move.id, robot_move.name, [str(a.vt) for a in robot_move.arguments]
    (72, 'Robot_Move', ['3', '3', '12', '8'])
"""

# No "from __future__ import annotations" here, because the table reads its argument types from the annotations.

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

from orinkit.cao.table import ENTRIES, I4, R4, AnyValue, Bstr, Function, Handle, function
from orinkit.core.i18n import tr
from orinkit.values.variant import Value


# fmt: off
@function(1, "Service_Start", "CCaoWorkspace::AddController", "RC8 3.1.1",
          en="Start the service of this connection.", ja="この接続のサービスを開始する。")
def service_start(option: Bstr | None = None) -> None: ...

@function(2, "Service_Stop", "CCaoWorkspaces::Remove", "RC8 3.1.5",
          en="Stop the service and release all objects of this connection.", ja="サービスを停止し、この接続の全オブジェクトを解放する。")
def service_stop() -> None: ...

@function(3, "Controller_Connect", "", "RC8 3.1.2", creates="Controller", released_by="Controller_Disconnect",
          en="Connect to a controller through a provider.", ja="プロバイダを通してコントローラに接続する。")
def controller_connect(name: Bstr, provider: Bstr, machine: Bstr, option: Bstr = "") -> Handle: ...

@function(4, "Controller_Disconnect", "", "RC8 3.1.4", releases=True,
          en="Disconnect from a controller and release its objects.", ja="コントローラから切断し、そのオブジェクトを解放する。")
def controller_disconnect(handle: Handle) -> None: ...

@function(5, "Controller_GetExtension", "CCaoController::AddExtension", "RC8 A", creates="Extension", released_by="Extension_Release",
          en="Connect to an extension board of the controller by name.", ja="コントローラの拡張ボードに名前で接続する。")
def controller_get_extension(handle: Handle, name: Bstr, option: Bstr = "") -> Handle: ...

@function(6, "Controller_GetFile", "CCaoController::AddFile", "RC8 A", creates="File", released_by="File_Release",
          en="Connect to a file of the controller by name.", ja="コントローラのファイルに名前で接続する。")
def controller_get_file(handle: Handle, name: Bstr, option: Bstr = "") -> Handle: ...

@function(7, "Controller_GetRobot", "CCaoController::AddRobot", "RC8 3.3.1", creates="Robot", released_by="Robot_Release",
          en="Connect to a robot of the controller by name.", ja="コントローラのロボットに名前で接続する。")
def controller_get_robot(handle: Handle, name: Bstr, option: Bstr = "") -> Handle: ...

@function(8, "Controller_GetTask", "CCaoController::AddTask", "RC8 3.2.1", creates="Task", released_by="Task_Release",
          en="Connect to a task of the controller by name.", ja="コントローラのタスクに名前で接続する。")
def controller_get_task(handle: Handle, name: Bstr, option: Bstr = "") -> Handle: ...

@function(9, "Controller_GetVariable", "CCaoController::AddVariable", "RC8 3.1.2", creates="Variable", released_by="Variable_Release",
          en="Connect to a variable of the controller by name.", ja="コントローラの変数に名前で接続する。")
def controller_get_variable(handle: Handle, name: Bstr, option: Bstr = "") -> Handle: ...

@function(10, "Controller_GetCommand", "CCaoController::AddCommand", "RC8 A", creates="Command", released_by="Command_Release",
          en="Connect to a command of the controller by name.", ja="コントローラのコマンドに名前で接続する。")
def controller_get_command(handle: Handle, name: Bstr, option: Bstr = "") -> Handle: ...

@function(11, "Controller_GetExtensionNames", "CCaoController::get_ExtensionNames", "RC8 A",
          en="Names of all extension boards of the controller.", ja="コントローラの拡張ボード名の一覧を得る。")
def controller_get_extension_names(handle: Handle, option: Bstr = "") -> AnyValue: ...

@function(12, "Controller_GetFileNames", "CCaoController::get_FileNames", "RC8 A",
          en="Names of all files of the controller.", ja="コントローラのファイル名の一覧を得る。")
def controller_get_file_names(handle: Handle, option: Bstr = "") -> AnyValue: ...

@function(13, "Controller_GetRobotNames", "CCaoController::get_RobotNames", "RC8 A",
          en="Names of all robots of the controller.", ja="コントローラのロボット名の一覧を得る。")
def controller_get_robot_names(handle: Handle, option: Bstr = "") -> AnyValue: ...

@function(14, "Controller_GetTaskNames", "CCaoController::get_TaskNames", "RC8 A",
          en="Names of all tasks of the controller.", ja="コントローラのタスク名の一覧を得る。")
def controller_get_task_names(handle: Handle, option: Bstr = "") -> AnyValue: ...

@function(15, "Controller_GetVariableNames", "CCaoController::get_VariableNames", "RC8 A",
          en="Names of all variables of the controller.", ja="コントローラの変数名の一覧を得る。")
def controller_get_variable_names(handle: Handle, option: Bstr = "") -> AnyValue: ...

@function(16, "Controller_GetCommandNames", "CCaoController::get_CommandNames", "RC8 A",
          en="Names of all commands of the controller.", ja="コントローラのコマンド名の一覧を得る。")
def controller_get_command_names(handle: Handle, option: Bstr = "") -> AnyValue: ...

@function(17, "Controller_Execute", "CCaoController::Execute", "RC8 3.3.6",
          en="Execute an extended command of the controller.", ja="コントローラの拡張コマンドを実行する。")
def controller_execute(handle: Handle, command: Bstr, parameter: Value = None) -> AnyValue: ...

@function(18, "Controller_GetMessage", "CCaoController::AddMessage", "RC8 A", creates="Message", released_by="Message_Release",
          en="Fetch the oldest waiting event message.", ja="待っている最も古いイベントメッセージを取り出す。")
def controller_get_message(handle: Handle) -> Handle: ...

@function(19, "Controller_GetAttribute", "CCaoController::get_Attribute", "RC8 A",
          en="Attribute bits of the controller.", ja="コントローラの属性値を得る。")
def controller_get_attribute(handle: Handle) -> I4: ...

@function(20, "Controller_GetHelp", "CCaoController::get_Help", "RC8 A",
          en="Help text of the controller.", ja="コントローラのヘルプ文字列を得る。")
def controller_get_help(handle: Handle) -> Bstr: ...

@function(21, "Controller_GetName", "CCaoController::get_Name", "RC8 A",
          en="Name of the controller.", ja="コントローラの名前を得る。")
def controller_get_name(handle: Handle) -> Bstr: ...

@function(22, "Controller_GetTag", "CCaoController::get_Tag", "RC8 A",
          en="Tag that the client keeps with the controller.", ja="クライアントがコントローラに付けたタグを得る。")
def controller_get_tag(handle: Handle) -> AnyValue: ...

@function(23, "Controller_PutTag", "CCaoController::put_Tag", "RC8 A",
          en="Set the tag of the controller.", ja="コントローラのタグを設定する。")
def controller_put_tag(handle: Handle, tag: Value) -> None: ...

@function(24, "Controller_GetID", "CCaoController::get_ID", "RC8 A",
          en="ID of the controller.", ja="コントローラの ID を得る。")
def controller_get_id(handle: Handle) -> AnyValue: ...

@function(25, "Controller_PutID", "CCaoController::put_ID", "RC8 A",
          en="Set the ID of the controller.", ja="コントローラの ID を設定する。")
def controller_put_id(handle: Handle, id: Value) -> None: ...

@function(26, "Extension_GetVariable", "CCaoExtension::AddVariable", "RC8 A", creates="Variable", released_by="Variable_Release",
          en="Connect to a variable of the extension board by name.", ja="拡張ボードの変数に名前で接続する。")
def extension_get_variable(handle: Handle, name: Bstr, option: Bstr = "") -> Handle: ...

@function(27, "Extension_GetVariableNames", "CCaoExtension::get_VariableNames", "RC8 A",
          en="Names of all variables of the extension board.", ja="拡張ボードの変数名の一覧を得る。")
def extension_get_variable_names(handle: Handle, option: Bstr = "") -> AnyValue: ...

@function(28, "Extension_Execute", "CCaoExtension::Execute", "RC8 A",
          en="Execute an extended command of the extension board.", ja="拡張ボードの拡張コマンドを実行する。")
def extension_execute(handle: Handle, command: Bstr, parameter: Value = None) -> AnyValue: ...

@function(29, "Extension_GetAttribute", "CCaoExtension::get_Attribute", "RC8 A",
          en="Attribute bits of the extension board.", ja="拡張ボードの属性値を得る。")
def extension_get_attribute(handle: Handle) -> I4: ...

@function(30, "Extension_GetHelp", "CCaoExtension::get_Help", "RC8 A",
          en="Help text of the extension board.", ja="拡張ボードのヘルプ文字列を得る。")
def extension_get_help(handle: Handle) -> Bstr: ...

@function(31, "Extension_GetName", "CCaoExtension::get_Name", "RC8 A",
          en="Name of the extension board.", ja="拡張ボードの名前を得る。")
def extension_get_name(handle: Handle) -> Bstr: ...

@function(32, "Extension_GetTag", "CCaoExtension::get_Tag", "RC8 A",
          en="Tag that the client keeps with the extension board.", ja="クライアントが拡張ボードに付けたタグを得る。")
def extension_get_tag(handle: Handle) -> AnyValue: ...

@function(33, "Extension_PutTag", "CCaoExtension::put_Tag", "RC8 A",
          en="Set the tag of the extension board.", ja="拡張ボードのタグを設定する。")
def extension_put_tag(handle: Handle, tag: Value) -> None: ...

@function(34, "Extension_GetID", "CCaoExtension::get_ID", "RC8 A",
          en="ID of the extension board.", ja="拡張ボードの ID を得る。")
def extension_get_id(handle: Handle) -> AnyValue: ...

@function(35, "Extension_PutID", "CCaoExtension::put_ID", "RC8 A",
          en="Set the ID of the extension board.", ja="拡張ボードの ID を設定する。")
def extension_put_id(handle: Handle, id: Value) -> None: ...

@function(36, "Extension_Release", "CCaoExtension::Release", "RC8 A", releases=True,
          en="Release the extension board.", ja="拡張ボードを解放する。")
def extension_release(handle: Handle) -> None: ...

@function(37, "File_GetFile", "CCaoFile::AddFile", "RC8 A", creates="File", released_by="File_Release",
          en="Connect to a file of the file by name.", ja="ファイルのファイルに名前で接続する。")
def file_get_file(handle: Handle, name: Bstr, option: Bstr = "") -> Handle: ...

@function(38, "File_GetVariable", "CCaoFile::AddVariable", "RC8 A", creates="Variable", released_by="Variable_Release",
          en="Connect to a variable of the file by name.", ja="ファイルの変数に名前で接続する。")
def file_get_variable(handle: Handle, name: Bstr, option: Bstr = "") -> Handle: ...

@function(39, "File_GetFileNames", "CCaoFile::get_FileNames", "RC8 A",
          en="Names of all files of the file.", ja="ファイルのファイル名の一覧を得る。")
def file_get_file_names(handle: Handle, option: Bstr = "") -> AnyValue: ...

@function(40, "File_GetVariableNames", "CCaoFile::get_VariableNames", "RC8 A",
          en="Names of all variables of the file.", ja="ファイルの変数名の一覧を得る。")
def file_get_variable_names(handle: Handle, option: Bstr = "") -> AnyValue: ...

@function(41, "File_Execute", "CCaoFile::Execute", "RC8 A",
          en="Execute an extended command of the file.", ja="ファイルの拡張コマンドを実行する。")
def file_execute(handle: Handle, command: Bstr, parameter: Value = None) -> AnyValue: ...

@function(42, "File_Copy", "CCaoFile::Copy", "RC8 A",
          en="Copy the file.", ja="ファイルをコピーする。")
def file_copy(handle: Handle, name: Bstr, option: Bstr = "") -> None: ...

@function(43, "File_Delete", "CCaoFile::Delete", "RC8 A",
          en="Delete the file.", ja="ファイルを削除する。")
def file_delete(handle: Handle, option: Bstr = "") -> None: ...

@function(44, "File_Move", "CCaoFile::Move", "RC8 A",
          en="Move or rename the file.", ja="ファイルを移動または改名する。")
def file_move(handle: Handle, name: Bstr, option: Bstr = "") -> None: ...

@function(45, "File_Run", "CCaoFile::Run", "RC8 A",
          en="Run the file; the name of the task is returned.", ja="ファイルを実行し、タスク名を得る。")
def file_run(handle: Handle, option: Bstr = "") -> Bstr: ...

@function(46, "File_GetDateCreated", "CCaoFile::get_DateCreated", "RC8 A",
          en="When the file was created.", ja="ファイルの作成日時を得る。")
def file_get_date_created(handle: Handle) -> AnyValue: ...

@function(47, "File_GetDateLastAccessed", "CCaoFile::get_DateLastAccessed", "RC8 A",
          en="When the file was last read.", ja="ファイルの最終アクセス日時を得る。")
def file_get_date_last_accessed(handle: Handle) -> AnyValue: ...

@function(48, "File_GetDateLastModified", "CCaoFile::get_DateLastModified", "RC8 A",
          en="When the file was last changed.", ja="ファイルの最終更新日時を得る。")
def file_get_date_last_modified(handle: Handle) -> AnyValue: ...

@function(49, "File_GetPath", "CCaoFile::get_Path", "RC8 A",
          en="Path of the file in the controller.", ja="コントローラ内のファイルのパスを得る。")
def file_get_path(handle: Handle) -> Bstr: ...

@function(50, "File_GetSize", "CCaoFile::get_Size", "RC8 A",
          en="Size of the file in bytes.", ja="ファイルのバイト数を得る。")
def file_get_size(handle: Handle) -> I4: ...

@function(51, "File_GetType", "CCaoFile::get_Type", "RC8 A",
          en="Type of the file.", ja="ファイルの種類を得る。")
def file_get_type(handle: Handle) -> Bstr: ...

@function(52, "File_GetValue", "CCaoFile::get_Value", "RC8 A",
          en="Content of the file.", ja="ファイルの内容を得る。")
def file_get_value(handle: Handle) -> AnyValue: ...

@function(53, "File_PutValue", "CCaoFile::put_Value", "RC8 A",
          en="Set the content of the file.", ja="ファイルの内容を書き込む。")
def file_put_value(handle: Handle, value: Value) -> None: ...

@function(54, "File_GetAttribute", "CCaoFile::get_Attribute", "RC8 A",
          en="Attribute bits of the file.", ja="ファイルの属性値を得る。")
def file_get_attribute(handle: Handle) -> I4: ...

@function(55, "File_GetHelp", "CCaoFile::get_Help", "RC8 A",
          en="Help text of the file.", ja="ファイルのヘルプ文字列を得る。")
def file_get_help(handle: Handle) -> Bstr: ...

@function(56, "File_GetName", "CCaoFile::get_Name", "RC8 A",
          en="Name of the file.", ja="ファイルの名前を得る。")
def file_get_name(handle: Handle) -> Bstr: ...

@function(57, "File_GetTag", "CCaoFile::get_Tag", "RC8 A",
          en="Tag that the client keeps with the file.", ja="クライアントがファイルに付けたタグを得る。")
def file_get_tag(handle: Handle) -> AnyValue: ...

@function(58, "File_PutTag", "CCaoFile::put_Tag", "RC8 A",
          en="Set the tag of the file.", ja="ファイルのタグを設定する。")
def file_put_tag(handle: Handle, tag: Value) -> None: ...

@function(59, "File_GetID", "CCaoFile::get_ID", "RC8 A",
          en="ID of the file.", ja="ファイルの ID を得る。")
def file_get_id(handle: Handle) -> AnyValue: ...

@function(60, "File_PutID", "CCaoFile::put_ID", "RC8 A",
          en="Set the ID of the file.", ja="ファイルの ID を設定する。")
def file_put_id(handle: Handle, id: Value) -> None: ...

@function(61, "File_Release", "CCaoFile::Release", "RC8 A", releases=True,
          en="Release the file.", ja="ファイルを解放する。")
def file_release(handle: Handle) -> None: ...

@function(62, "Robot_GetVariable", "CCaoRobot::AddVariable", "VE026A 5.3.3", creates="Variable", released_by="Variable_Release",
          en="Connect to a variable of the robot by name.", ja="ロボットの変数に名前で接続する。")
def robot_get_variable(handle: Handle, name: Bstr, option: Bstr = "") -> Handle: ...

@function(63, "Robot_GetVariableNames", "CCaoRobot::get_VariableNames", "RC8 A",
          en="Names of all variables of the robot.", ja="ロボットの変数名の一覧を得る。")
def robot_get_variable_names(handle: Handle, option: Bstr = "") -> AnyValue: ...

@function(64, "Robot_Execute", "CCaoRobot::Execute", "RC8 3.3.2",
          en="Execute an extended command of the robot.", ja="ロボットの拡張コマンドを実行する。")
def robot_execute(handle: Handle, command: Bstr, parameter: Value = None) -> AnyValue: ...

@function(65, "Robot_Accelerate", "CCaoRobot::Accelerate", "RC8 A",
          en="Set internal acceleration and deceleration in percent.", ja="内部加速度と減速度 (%) を設定する。")
def robot_accelerate(handle: Handle, axis: I4, accel: R4, decel: R4 = -1.0) -> None: ...

@function(66, "Robot_Change", "CCaoRobot::Change", "RC8 A",
          en="Change the tool or work frame in use.", ja="使用するツールまたはワーク座標系を切り替える。")
def robot_change(handle: Handle, name: Bstr) -> None: ...

@function(67, "Robot_Chuck", "CCaoRobot::Chuck", "RC8 A",
          en="Close the chuck.", ja="チャックを閉じる。")
def robot_chuck(handle: Handle, option: Bstr = "") -> None: ...

@function(68, "Robot_Drive", "CCaoRobot::Drive", "RC8 A",
          en="Move one joint by degrees or mm.", ja="1 軸を相対動作させる (度または mm)。")
def robot_drive(handle: Handle, axis: I4, value: R4, option: Bstr = "") -> None: ...

@function(69, "Robot_GoHome", "CCaoRobot::GoHome", "RC8 A",
          en="Move to the home pose.", ja="ホーム位置へ動作させる。")
def robot_go_home(handle: Handle) -> None: ...

@function(70, "Robot_Halt", "CCaoRobot::Halt", "RC8 3.3.4",
          en="Stop the motion and abandon it.", ja="動作を停止し、打ち切る。")
def robot_halt(handle: Handle, option: Bstr = "") -> None: ...

@function(71, "Robot_Hold", "CCaoRobot::Hold", "RC8 A",
          en="Pause the motion.", ja="動作を一時停止する。")
def robot_hold(handle: Handle, option: Bstr = "") -> None: ...

@function(72, "Robot_Move", "CCaoRobot::Move", "RC8 3.3.4",
          en="Move to a pose.", ja="指定したポーズへ動作させる。")
def robot_move(handle: Handle, interpolation: I4, pose: Value, option: Bstr = "") -> None: ...

@function(73, "Robot_Rotate", "CCaoRobot::Rotate", "RC8 A",
          en="Rotate about an axis through a pivot by degrees.", ja="基準点を通る軸のまわりに回転させる (度)。")
def robot_rotate(handle: Handle, plane: Value, angle: R4, pivot: Value, option: Bstr = "") -> None: ...

@function(74, "Robot_Speed", "CCaoRobot::Speed", "RC8 A",
          en="Set the internal speed in percent.", ja="内部速度 (%) を設定する。")
def robot_speed(handle: Handle, axis: I4, speed: R4) -> None: ...

@function(75, "Robot_Unchuck", "CCaoRobot::Unchuck", "RC8 A",
          en="Open the chuck.", ja="チャックを開く。")
def robot_unchuck(handle: Handle, option: Bstr = "") -> None: ...

@function(76, "Robot_Unhold", "CCaoRobot::Unhold", "RC8 A",
          en="Resume a paused motion.", ja="一時停止した動作を再開する。")
def robot_unhold(handle: Handle, option: Bstr = "") -> None: ...

@function(77, "Robot_GetAttribute", "CCaoRobot::get_Attribute", "RC8 A",
          en="Attribute bits of the robot.", ja="ロボットの属性値を得る。")
def robot_get_attribute(handle: Handle) -> I4: ...

@function(78, "Robot_GetHelp", "CCaoRobot::get_Help", "RC8 A",
          en="Help text of the robot.", ja="ロボットのヘルプ文字列を得る。")
def robot_get_help(handle: Handle) -> Bstr: ...

@function(79, "Robot_GetName", "CCaoRobot::get_Name", "RC8 A",
          en="Name of the robot.", ja="ロボットの名前を得る。")
def robot_get_name(handle: Handle) -> Bstr: ...

@function(80, "Robot_GetTag", "CCaoRobot::get_Tag", "RC8 A",
          en="Tag that the client keeps with the robot.", ja="クライアントがロボットに付けたタグを得る。")
def robot_get_tag(handle: Handle) -> AnyValue: ...

@function(81, "Robot_PutTag", "CCaoRobot::put_Tag", "RC8 A",
          en="Set the tag of the robot.", ja="ロボットのタグを設定する。")
def robot_put_tag(handle: Handle, tag: Value) -> None: ...

@function(82, "Robot_GetID", "CCaoRobot::get_ID", "RC8 A",
          en="ID of the robot.", ja="ロボットの ID を得る。")
def robot_get_id(handle: Handle) -> AnyValue: ...

@function(83, "Robot_PutID", "CCaoRobot::put_ID", "RC8 A",
          en="Set the ID of the robot.", ja="ロボットの ID を設定する。")
def robot_put_id(handle: Handle, id: Value) -> None: ...

@function(84, "Robot_Release", "CCaoRobot::Release", "RC8 3.3.5", releases=True,
          en="Release the robot.", ja="ロボットを解放する。")
def robot_release(handle: Handle) -> None: ...

@function(85, "Task_GetVariable", "CCaoTask::AddVariable", "RC8 A", creates="Variable", released_by="Variable_Release",
          en="Connect to a variable of the task by name.", ja="タスクの変数に名前で接続する。")
def task_get_variable(handle: Handle, name: Bstr, option: Bstr = "") -> Handle: ...

@function(86, "Task_GetVariableNames", "CCaoTask::get_VariableNames", "RC8 A",
          en="Names of all variables of the task.", ja="タスクの変数名の一覧を得る。")
def task_get_variable_names(handle: Handle, option: Bstr = "") -> AnyValue: ...

@function(87, "Task_Execute", "CCaoTask::Execute", "RC8 A",
          en="Execute an extended command of the task.", ja="タスクの拡張コマンドを実行する。")
def task_execute(handle: Handle, command: Bstr, parameter: Value = None) -> AnyValue: ...

@function(88, "Task_Start", "CCaoTask::Start", "RC8 3.2.2",
          en="Start the task: 1 one cycle, 2 continuous, 3 step.", ja="タスクを開始する (1 サイクル、2 連続、3 ステップ)。")
def task_start(handle: Handle, mode: I4, option: Bstr = "") -> None: ...

@function(89, "Task_Stop", "CCaoTask::Stop", "RC8 3.2.2",
          en="Stop the task: 0 default, 1 instant, 2 step, 3 cycle, 4 initialise.", ja="タスクを停止する (0 既定、1 瞬時、2 ステップ、3 サイクル、4 初期化)。")
def task_stop(handle: Handle, mode: I4, option: Bstr = "") -> None: ...

@function(90, "Task_Delete", "CCaoTask::Delete", "RC8 A",
          en="Delete the task.", ja="タスクを削除する。")
def task_delete(handle: Handle, option: Bstr = "") -> None: ...

@function(91, "Task_GetFileName", "CCaoTask::get_FileName", "RC8 A",
          en="File that the task came from.", ja="タスクの元ファイル名を得る。")
def task_get_file_name(handle: Handle) -> Bstr: ...

@function(92, "Task_GetAttribute", "CCaoTask::get_Attribute", "RC8 A",
          en="Attribute bits of the task.", ja="タスクの属性値を得る。")
def task_get_attribute(handle: Handle) -> I4: ...

@function(93, "Task_GetHelp", "CCaoTask::get_Help", "RC8 A",
          en="Help text of the task.", ja="タスクのヘルプ文字列を得る。")
def task_get_help(handle: Handle) -> Bstr: ...

@function(94, "Task_GetName", "CCaoTask::get_Name", "RC8 A",
          en="Name of the task.", ja="タスクの名前を得る。")
def task_get_name(handle: Handle) -> Bstr: ...

@function(95, "Task_GetTag", "CCaoTask::get_Tag", "RC8 A",
          en="Tag that the client keeps with the task.", ja="クライアントがタスクに付けたタグを得る。")
def task_get_tag(handle: Handle) -> AnyValue: ...

@function(96, "Task_PutTag", "CCaoTask::put_Tag", "RC8 A",
          en="Set the tag of the task.", ja="タスクのタグを設定する。")
def task_put_tag(handle: Handle, tag: Value) -> None: ...

@function(97, "Task_GetID", "CCaoTask::get_ID", "RC8 A",
          en="ID of the task.", ja="タスクの ID を得る。")
def task_get_id(handle: Handle) -> AnyValue: ...

@function(98, "Task_PutID", "CCaoTask::put_ID", "RC8 A",
          en="Set the ID of the task.", ja="タスクの ID を設定する。")
def task_put_id(handle: Handle, id: Value) -> None: ...

@function(99, "Task_Release", "CCaoTask::Release", "RC8 3.2.3", releases=True,
          en="Release the task.", ja="タスクを解放する。")
def task_release(handle: Handle) -> None: ...

@function(100, "Variable_GetDateTime", "CCaoVariable::get_DateTime", "RC8 A",
          en="Date and time of the value.", ja="値の日時を得る。")
def variable_get_date_time(handle: Handle) -> AnyValue: ...

@function(101, "Variable_GetValue", "CCaoVariable::get_Value", "RC8 3.1.3",
          en="Value of the variable.", ja="変数の値を得る。")
def variable_get_value(handle: Handle) -> AnyValue: ...

@function(102, "Variable_PutValue", "CCaoVariable::put_Value", "RC8 3.1.3",
          en="Set the value of the variable.", ja="変数の値を書き込む。")
def variable_put_value(handle: Handle, value: Value) -> None: ...

@function(103, "Variable_GetAttribute", "CCaoVariable::get_Attribute", "RC8 A",
          en="Attribute bits of the variable.", ja="変数の属性値を得る。")
def variable_get_attribute(handle: Handle) -> I4: ...

@function(104, "Variable_GetHelp", "CCaoVariable::get_Help", "RC8 A",
          en="Help text of the variable.", ja="変数のヘルプ文字列を得る。")
def variable_get_help(handle: Handle) -> Bstr: ...

@function(105, "Variable_GetName", "CCaoVariable::get_Name", "RC8 A",
          en="Name of the variable.", ja="変数の名前を得る。")
def variable_get_name(handle: Handle) -> Bstr: ...

@function(106, "Variable_GetTag", "CCaoVariable::get_Tag", "RC8 A",
          en="Tag that the client keeps with the variable.", ja="クライアントが変数に付けたタグを得る。")
def variable_get_tag(handle: Handle) -> AnyValue: ...

@function(107, "Variable_PutTag", "CCaoVariable::put_Tag", "RC8 A",
          en="Set the tag of the variable.", ja="変数のタグを設定する。")
def variable_put_tag(handle: Handle, tag: Value) -> None: ...

@function(108, "Variable_GetID", "CCaoVariable::get_ID", "RC8 A",
          en="ID of the variable.", ja="変数の ID を得る。")
def variable_get_id(handle: Handle) -> AnyValue: ...

@function(109, "Variable_PutID", "CCaoVariable::put_ID", "RC8 A",
          en="Set the ID of the variable.", ja="変数の ID を設定する。")
def variable_put_id(handle: Handle, id: Value) -> None: ...

@function(110, "Variable_GetMicrosecond", "CCaoVariable::get_Microsecond", "RC8 A",
          en="Microseconds of the date and time of the value.", ja="値の日時のマイクロ秒を得る。")
def variable_get_microsecond(handle: Handle) -> I4: ...

@function(111, "Variable_Release", "CCaoVariable::Release", "RC8 3.1.4", releases=True,
          en="Release the variable.", ja="変数を解放する。")
def variable_release(handle: Handle) -> None: ...

@function(112, "Command_Execute", "CCaoCommand::Execute", "RC8 A",
          en="Execute the command: 0 wait for its end, 1 return immediately.", ja="コマンドを実行する (0 完了待ち、1 即時復帰)。")
def command_execute(handle: Handle, mode: I4 = 0) -> None: ...

@function(113, "Command_Cancel", "CCaoCommand::Cancel", "RC8 A",
          en="Cancel the running command.", ja="実行中のコマンドを取り消す。")
def command_cancel(handle: Handle) -> None: ...

@function(114, "Command_GetTimeout", "CCaoCommand::get_Timeout", "RC8 A",
          en="Time-out of the command in ms.", ja="コマンドのタイムアウト (ms) を得る。")
def command_get_timeout(handle: Handle) -> I4: ...

@function(115, "Command_PutTimeout", "CCaoCommand::put_Timeout", "RC8 A",
          en="Set the time-out of the command in ms.", ja="コマンドのタイムアウト (ms) を設定する。")
def command_put_timeout(handle: Handle, timeout: I4) -> None: ...

@function(116, "Command_GetState", "CCaoCommand::get_State", "RC8 A",
          en="State of the command.", ja="コマンドの状態を得る。")
def command_get_state(handle: Handle) -> I4: ...

@function(117, "Command_GetParameters", "CCaoCommand::get_Parameters", "RC8 A",
          en="Parameters of the command.", ja="コマンドのパラメータを得る。")
def command_get_parameters(handle: Handle) -> AnyValue: ...

@function(118, "Command_PutParameters", "CCaoCommand::put_Parameters", "RC8 A",
          en="Set the parameters of the command.", ja="コマンドのパラメータを設定する。")
def command_put_parameters(handle: Handle, parameters: Value) -> None: ...

@function(119, "Command_GetResult", "CCaoCommand::get_Result", "RC8 A",
          en="Result of the command.", ja="コマンドの実行結果を得る。")
def command_get_result(handle: Handle) -> AnyValue: ...

@function(120, "Command_GetAttribute", "CCaoCommand::get_Attribute", "RC8 A",
          en="Attribute bits of the command.", ja="コマンドの属性値を得る。")
def command_get_attribute(handle: Handle) -> I4: ...

@function(121, "Command_GetHelp", "CCaoCommand::get_Help", "RC8 A",
          en="Help text of the command.", ja="コマンドのヘルプ文字列を得る。")
def command_get_help(handle: Handle) -> Bstr: ...

@function(122, "Command_GetName", "CCaoCommand::get_Name", "RC8 A",
          en="Name of the command.", ja="コマンドの名前を得る。")
def command_get_name(handle: Handle) -> Bstr: ...

@function(123, "Command_GetTag", "CCaoCommand::get_Tag", "RC8 A",
          en="Tag that the client keeps with the command.", ja="クライアントがコマンドに付けたタグを得る。")
def command_get_tag(handle: Handle) -> AnyValue: ...

@function(124, "Command_PutTag", "CCaoCommand::put_Tag", "RC8 A",
          en="Set the tag of the command.", ja="コマンドのタグを設定する。")
def command_put_tag(handle: Handle, tag: Value) -> None: ...

@function(125, "Command_GetID", "CCaoCommand::get_ID", "RC8 A",
          en="ID of the command.", ja="コマンドの ID を得る。")
def command_get_id(handle: Handle) -> AnyValue: ...

@function(126, "Command_PutID", "CCaoCommand::put_ID", "RC8 A",
          en="Set the ID of the command.", ja="コマンドの ID を設定する。")
def command_put_id(handle: Handle, id: Value) -> None: ...

@function(127, "Command_Release", "CCaoCommand::Release", "RC8 A", releases=True,
          en="Release the command.", ja="コマンドを解放する。")
def command_release(handle: Handle) -> None: ...

@function(128, "Message_Reply", "CCaoMessage::Reply", "RC8 A",
          en="Reply to the event message.", ja="イベントメッセージに応答する。")
def message_reply(handle: Handle, value: Value) -> None: ...

@function(129, "Message_Clear", "CCaoMessage::Clear", "RC8 A",
          en="Clear the event message.", ja="イベントメッセージを消す。")
def message_clear(handle: Handle) -> None: ...

@function(130, "Message_GetDateTime", "CCaoMessage::get_DateTime", "RC8 A",
          en="Date and time of the event.", ja="イベントの日時を得る。")
def message_get_date_time(handle: Handle) -> AnyValue: ...

@function(131, "Message_GetDescription", "CCaoMessage::get_Description", "RC8 A",
          en="Description of the event.", ja="イベントの説明文を得る。")
def message_get_description(handle: Handle) -> Bstr: ...

@function(132, "Message_GetDestination", "CCaoMessage::get_Destination", "RC8 A",
          en="Destination of the message.", ja="メッセージの送信先を得る。")
def message_get_destination(handle: Handle) -> Bstr: ...

@function(133, "Message_GetNumber", "CCaoMessage::get_Number", "RC8 A",
          en="Number of the kind of event.", ja="イベントの種類を表す番号を得る。")
def message_get_number(handle: Handle) -> I4: ...

@function(134, "Message_GetSerialNumber", "CCaoMessage::get_SerialNumber", "RC8 A",
          en="Serial number of the message.", ja="メッセージの通し番号を得る。")
def message_get_serial_number(handle: Handle) -> I4: ...

@function(135, "Message_GetSource", "CCaoMessage::get_Source", "RC8 A",
          en="Source of the message.", ja="メッセージの送信元を得る。")
def message_get_source(handle: Handle) -> Bstr: ...

@function(136, "Message_GetValue", "CCaoMessage::get_Value", "RC8 A",
          en="Value that came with the event.", ja="イベントに伴う値を得る。")
def message_get_value(handle: Handle) -> AnyValue: ...

@function(137, "Message_Release", "CCaoMessage::Release", "e-CAP 3.3", releases=True,
          en="Release the message.", ja="メッセージを解放する。")
def message_release(handle: Handle) -> None: ...

# fmt: on


FUNCTIONS: Final[Mapping[int, Function[..., Any]]] = MappingProxyType(ENTRIES)
"""Every function by id."""

BY_NAME: Final[Mapping[str, Function[..., Any]]] = MappingProxyType({entry.name: entry for entry in ENTRIES.values()})
"""Every function by its name in the documents."""


def find(name: str | int) -> Function[..., Any]:
    """Return a function by its id, or by its name in the documents or in Python, in upper or lower case.

    Raises:
        KeyError: If there is no such function; the message contains similar names.
    """
    if isinstance(name, int) or name.isdecimal():
        found = ENTRIES.get(int(name))
    else:
        wanted = name.replace("_", "").lower()
        found = next((entry for entry in ENTRIES.values() if entry.name.replace("_", "").lower() == wanted), None)
    if found is None:
        from difflib import get_close_matches  # imported only in case of an error

        near = ", ".join(get_close_matches(str(name), BY_NAME, n=3, cutoff=0.4))
        if near:
            raise KeyError(tr("unknown function {name!r}; did you mean {near}?", name=name, near=near))
        raise KeyError(tr("unknown function {name!r}; ids are 1 to {count}", name=name, count=len(ENTRIES)))
    return found
