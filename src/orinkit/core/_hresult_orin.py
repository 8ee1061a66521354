"""Return codes of ORiN, CAO and b-CAP, one row per code.

Sources: VE026A table 3-5, e-CAP table 4, and codes common to published b-CAP clients and servers. The texts are this
project's own. :mod:`orinkit.core.hresult` builds its table from these rows.
"""

from __future__ import annotations

from typing import Final

# fmt: off
#: Remedies, each shared by several codes: key -> (English, Japanese).
HINTS: Final[dict[str, tuple[str, str]]] = {
    "": ("", ""),
    "access": ("Check the communication permission of this client and which client has write permission; behind a gateway, check its access rules.", "このクライアントの通信権限と、書き込み権限の所在を確認してください。ゲートウェイ経由の場合は、その許可リストも確認してください。"),
    "arguments": ("Check the number, the types and the order of the arguments.", "引数の個数・型・順序を確認してください。"),
    "busy": ("Wait for the reply to the previous request, or use a second connection.", "前の要求の応答を待つか、別の接続を使ってください。"),
    "clients": ("Close unused connections, then connect again.", "使っていない接続を閉じてから、接続し直してください。"),
    "command": ("Check the name of the command and whether this controller supports it.", "コマンド名のつづりと、コントローラがそのコマンドに対応しているかを確認してください。"),
    "connect": ("Connect first; if the connection was lost, connect again and get new objects.", "先に接続してください。切断された場合は、再接続してオブジェクトを取得し直してください。"),
    "exists": ("Choose another name, or add the option @IfNotMember to get the existing object.", "別の名前を使うか、オプション @IfNotMember を付けて既存のオブジェクトを取得してください。"),
    "handle": ("Get the object again; its handle was released or belongs to another connection.", "オブジェクトを取得し直してください。ハンドルは解放済みか、別の接続のものです。"),
    "implement": ("This device does not implement the function; see its manual for an alternative.", "この機器はその関数に対応していません。代わりの関数を機器の説明書で確認してください。"),
    "index": ("Use an index that exists.", "存在する番号を指定してください。"),
    "licence": ("Register the licence of the option on the controller or the PC.", "コントローラまたはPCに、該当オプションのライセンスを登録してください。"),
    "machine": ("Check the computer name and whether the computer is reachable.", "コンピュータ名と、そのコンピュータに接続できるかを確認してください。"),
    "memory": ("Release unused objects, send less data per call, or repeat the call later.", "不要なオブジェクトを解放するか、一度に送るデータを減らすか、後でやり直してください。"),
    "name": ("Check the name; the ...Names functions list the existing names.", "名前のつづりを確認してください。存在する名前は …Names 関数で一覧できます。"),
    "network": ("Check the cable, the address and the port, then connect again.", "ケーブル・アドレス・ポート番号を確認し、接続し直してください。"),
    "objects": ("Release unused objects.", "使っていないオブジェクトを解放してください。"),
    "packet": ("Client and server interpret the packet differently; decode its bytes to find the difference.", "双方のパケットの解釈が食い違っています。バイト列を解読して、違う箇所を探してください。"),
    "provider": ("Specify the provider of the controller (provider=, --provider): CaoProv.DENSO.VRC (RC8, COBOTTA), CaoProv.DENSO.VRC9 (RC9), or the name of your own device's provider.", "コントローラに合ったプロバイダ名を指定してください (provider=、--provider): CaoProv.DENSO.VRC (RC8, COBOTTA)、CaoProv.DENSO.VRC9 (RC9)、または自作デバイスのプロバイダ名。"),
    "restart": ("Restart the controller's service; if the error recurs, check the controller's log.", "コントローラのサービスを再起動してください。再発する場合は、コントローラのログを確認してください。"),
    "size": ("Split the data over several calls, or use TCP (16 MiB) instead of UDP (503 bytes).", "データを複数回に分けてください。UDPの上限は503バイトです。TCP (16MiB) も検討してください。"),
    "arm": ("Check the command. A VE026A supports only Motor, slvChangeMode, slvMove and ClearError; in Python, connect with dialect='ve026a'.", "つづりを確認してください。VE026A のコマンドは Motor、slvChangeMode、slvMove、ClearError のみです。Python では dialect='ve026a' で接続してください。"),
    "timeout": ("Use a longer timeout, or check whether the previous command is still executing.", "タイムアウトを長くするか、前のコマンドがまだ実行中でないか確認してください。"),
    "type": ("Convert the value to the type of the variable or argument.", "変数または引数の型に値を変換してください。"),
    "value": ("Use a value that fits the type.", "型に収まる値を指定してください。"),
    "wait": ("Wait, then send the request again.", "しばらく待ってから、要求を送り直してください。"),
    "write": ("The item is read-only; do not write it.", "読み出し専用として扱ってください。"),
}

#: (value, name, English, Japanese, key of the hint).
ROWS: Final[tuple[tuple[int, str, str, str, str], ...]] = (
    (0x00000000, "S_OK", "Success", "正常終了", ""),
    (0x00000001, "S_FALSE", "Success, result false", "成功（結果は偽）", ""),
    (0x00000900, "S_EXECUTING", "Still executing; the reply follows", "実行中（応答は後から届く）", ""),
    (0x80000200, "E_CAO_SEM_CREATE", "The CAO engine could not create a semaphore", "CAOエンジンがセマフォを作成できない", "restart"),
    (0x80000201, "E_CAO_PROV_INVALID", "Unknown or invalid provider", "プロバイダが存在しないか不正", "provider"),
    (0x80000202, "E_CAO_COMPUTER_NAME", "Invalid computer name", "コンピュータ名が不正", "machine"),
    (0x80000203, "E_CAO_VARIANT_TYPE_NOSUPPORT", "VARIANT type not supported", "対応していないVARIANT型", "type"),
    (0x80000204, "E_CAO_OBJECT_NOTFOUND", "Object not found", "オブジェクトが見つからない", "name"),
    (0x80000205, "E_CAO_COLLECTION_REGISTERED", "An object of this name is already registered", "同じ名前のオブジェクトが登録済み", "exists"),
    (0x80000207, "E_CAO_THREAD_CREATE", "The CAO engine could not create a thread", "CAOエンジンがスレッドを作成できない", "restart"),
    (0x80000208, "E_CAO_REMOTE_ENGINE", "The remote CAO engine cannot be used", "リモートのCAOエンジンを利用できない", "machine"),
    (0x80000209, "E_CAO_REMOTE_PROVIDER", "The remote provider cannot be used", "リモートのプロバイダを利用できない", "machine"),
    (0x8000020A, "E_CAO_NOT_WRITABLE", "Not writable", "書き込みできない", "write"),
    (0x8000020B, "E_CAO_CMD_EXECUTE", "A command is already being executed", "コマンドが既に実行中", "busy"),
    (0x8000020C, "E_CAO_PROV_NO_LICENSE", "No licence for the provider", "プロバイダのライセンスがない", "licence"),
    (0x8000020D, "E_CAO_PRELOAD", "The provider could not be loaded in advance", "プロバイダの事前読み込みに失敗", "restart"),
    (0x80000400, "E_CRDIMPL", "Defined by the CRD file of the device", "機器のCRDファイルの定義に従う項目", ""),
    (0x80000401, "E_CAOP_SYSTEMNAME_INVALID", "Invalid system variable name", "システム変数名が不正", "name"),
    (0x80000402, "E_CAOP_SYSTEMTYPE_INVALID", "Invalid system variable type", "システム変数の型が不正", "type"),
    (0x80000403, "E_CANCEL", "Cancelled", "取り消された", ""),
    (0x80000404, "E_CAOP_NOT_WRITABLE", "The provider does not allow writing", "プロバイダが書き込みを許可していない", "write"),
    (0x80000900, "E_TIMEOUT", "Timed out", "タイムアウト", "timeout"),
    (0x80000901, "E_NO_LICENSE", "No licence", "ライセンスがない", "licence"),
    (0x80000902, "E_NOT_CONNECTED", "Not connected", "接続されていない", "connect"),
    (0x80000903, "E_NOT_USE", "Not usable", "使用できない", "implement"),
    (0x80000904, "E_INVALID_CMD_NAME", "Unknown command name", "コマンド名が不正", "command"),
    (0x80000905, "E_MAX_OBJECT", "Too many objects", "オブジェクト数が上限に達した", "objects"),
    (0x80000906, "E_ALREADY_REGISTER", "Already registered", "登録済み", "exists"),
    (0x80000909, "E_TOO_MUCH_DATA", "Too much data", "データ量が多すぎる", "size"),
    (0x8000090B, "E_MAX_CONNECT", "Too many connections", "接続数が上限に達した", "clients"),
    (0x80004001, "E_NOTIMPL", "Not implemented", "未実装", "implement"),
    (0x80004003, "E_POINTER", "Invalid pointer", "ポインタが不正", "arguments"),
    (0x80004004, "E_ABORT", "The function was aborted", "関数の処理が中断された", ""),
    (0x80004005, "E_FAIL", "The function failed", "関数の処理に失敗", ""),
    (0x8000FFFF, "E_UNEXPECTED", "Unexpected fatal error", "予期しない致命的エラー", "restart"),
    (0x80010000, "E_INVALIDPACKET", "Invalid packet", "パケットが不正", "packet"),
    (0x80010001, "E_INVALIDRCVPACKET", "Invalid packet received; the device closes the connection", "受信パケットが不正（機器側から切断される）", "packet"),
    (0x80010002, "E_INVALIDSNDPACKET", "Invalid packet sent", "送信パケットが不正", "packet"),
    (0x80010003, "E_INVALIDARGTYPE", "Invalid argument type", "引数の型が不正", "arguments"),
    (0x80010004, "E_ROBOTISBUSY", "The robot is busy", "ロボットがビジー状態", "wait"),
    (0x80010005, "E_INVALIDCOMMAND", "Invalid command string", "コマンド文字列が不正", "arm"),
    (0x80010011, "E_PACKETSIZEOVER", "Packet too large (over 16 MiB)", "パケットが大きすぎる（16MiB超）", "size"),
    (0x80010012, "E_ARGSIZEOVER", "Argument too large (over 16 MiB)", "引数が大きすぎる（16MiB超）", "size"),
    (0x80020005, "DISP_E_TYPEMISMATCH", "Type mismatch", "型が一致しない", "type"),
    (0x80020008, "DISP_E_BADVARTYPE", "Invalid VARIANT type", "VARIANT型が不正", "type"),
    (0x8002000A, "DISP_E_OVERFLOW", "The value does not fit its type", "値が型の範囲を超えた", "value"),
    (0x8002000B, "DISP_E_BADINDEX", "Invalid index", "番号（インデックス）が不正", "index"),
    (0x80070005, "E_ACCESSDENIED", "Access denied", "アクセスが拒否された", "access"),
    (0x80070006, "E_HANDLE", "Invalid handle", "ハンドルが不正", "handle"),
    (0x8007000E, "E_OUTOFMEMORY", "Out of memory", "メモリ不足", "memory"),
    (0x80070057, "E_INVALIDARG", "Invalid argument", "引数が不正", "arguments"),
    (0x800706BE, "RPC_S_CALL_FAILED", "A call inside the controller failed (remote procedure call)", "コントローラ内部の呼び出し（RPC）に失敗", "restart"),
    (0x809100AA, "E_BUSY_PROC", "The previous request is still being processed", "前の要求を処理中", "busy"),
)

#: Texts for codes of a COM facility (the high 16 bits) that are not in :data:`ROWS`; ``{number}`` is the low 16 bits.
FACILITIES: Final[dict[int, tuple[str, str]]] = {
    0x8002: ("Automation error {number}", "オートメーションのエラー {number}"),
    0x8007: ("Windows error {number}", "Windowsのエラー {number}"),
}
# fmt: on
