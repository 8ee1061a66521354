"""The frames of ABH3 drivers and their fields: section 2 of the document and the changes of 2023, as an independent copy."""

from __future__ import annotations

from orinkit.abh3.table.signals import V1, V2

TENTHS = {"v1": V1.with_load_unit(0.1), "v2": V2.with_load_unit(0.1)}

# frame: section, data page, number of the broadcast, and for each field: name, name in the document, first byte, number
# of bytes, type code; "h" and "i" are signed, "H" and "I" unsigned
FRAMES_ALIKE = {
    "DP0S": ("2.1", 0, None, [
        ("ay_command", "A/Y 指令", 1, 2, "h"), ("bx_command", "B/X 指令", 3, 2, "h")]),
    "DP1R": ("2.2", 1, None, [
        ("a_pulses", "Aパルス積算値", 1, 4, "i"), ("b_pulses", "Bパルス積算値", 5, 4, "i")]),
    "BR0": ("2.3", 0, 0, [("errors", "異常フラグ", 1, 4, "I"), ("warnings", "警告フラグ", 5, 4, "I")]),
    "BR2": ("2.5", 0, 2, [
        ("ay_velocity_command", "A/Y 速度指令", 1, 2, "h"), ("bx_velocity_command", "B/X 速度指令", 3, 2, "h"),
        ("ay_velocity", "A/Y 速度帰還", 5, 2, "h"), ("bx_velocity", "B/X 速度帰還", 7, 2, "h")]),
    "BR3": ("2.6", 0, 3, [
        ("ay_current_command", "A/Y 電流指令", 1, 2, "h"), ("bx_current_command", "B/X 電流指令", 3, 2, "h"),
        ("a_load", "A 負荷率", 5, 2, "H"), ("b_load", "B 負荷率", 7, 2, "H")]),
    "BR4": ("2.7", 0, 4, [
        ("a_pulses", "A パルス積算値", 1, 4, "i"), ("b_pulses", "B パルス積算値", 5, 4, "i")]),
    "BR5": ("2.8", 0, 5, [
        ("analog_0", "アナログ入力 0", 1, 2, "h"), ("analog_1", "アナログ入力 1", 3, 2, "h"),
        ("main_voltage", "主電源電圧", 5, 2, "H"), ("control_voltage", "制御電源電圧", 7, 2, "H")]),
    "BR6": ("2.9", 0, 6, [("monitor_0", "モニタ 0 データ", 1, 4, "f"), ("monitor_1", "モニタ 1 データ", 5, 4, "f")]),
}  # fmt: skip
FRAMES = {
    "v1": {
        **FRAMES_ALIKE,
        "DP0S": (*FRAMES_ALIKE["DP0S"][:3], [*FRAMES_ALIKE["DP0S"][3], ("inputs", "入力", 5, 4, "I")]),
        "DP0R": ("2.1", 0, None, [
            ("a_velocity", "A 速度帰還", 1, 2, "h"), ("b_velocity", "B 速度帰還", 3, 2, "h"),
            ("y_velocity", "Y 速度帰還", 5, 2, "h"), ("x_velocity", "X 速度帰還", 7, 2, "h")]),
        "BR1": ("2.4", 0, 1, [("control", "制御フラグ", 1, 4, "I"), ("io", "I/O フラグ", 5, 4, "I")]),
    },
    "v2": {
        **FRAMES_ALIKE,
        "DP0S": (*FRAMES_ALIKE["DP0S"][:3], [*FRAMES_ALIKE["DP0S"][3], ("inputs", "操作フラグ", 5, 4, "I")]),
        "DP0R": ("2.1", 0, None, [
            ("ay_velocity", "A/Y 速度帰還", 1, 2, "h"), ("bx_velocity", "B/X 速度帰還", 3, 2, "h"),
            ("control", "制御フラグ", 5, 4, "I")]),
        "BR1": ("2.4", 0, 1, [("io", "I/O フラグ", 1, 4, "I"), ("external", "入力フラグ", 5, 4, "I")]),
    },
}  # fmt: skip

# field name: unit, codes per unit (section 3)
QUANTITIES = {
    **dict.fromkeys(("ay_command", "bx_command", "a_velocity", "b_velocity", "y_velocity", "x_velocity"), ("min^-1", 5)),
    **dict.fromkeys(("ay_velocity", "bx_velocity", "ay_velocity_command", "bx_velocity_command"), ("min^-1", 5)),
    **dict.fromkeys(("ay_current_command", "bx_current_command"), ("%", 100)),
    **dict.fromkeys(("a_load", "b_load"), ("%", 1)),
    **dict.fromkeys(("a_pulses", "b_pulses"), ("pulse", 1)),
    **dict.fromkeys(("analog_0", "analog_1"), ("V", 100)),
    **dict.fromkeys(("main_voltage", "control_voltage"), ("V", 10)),
    **dict.fromkeys(("monitor_0", "monitor_1"), ("", 0)),
}  # fmt: skip
