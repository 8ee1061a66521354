r"""The grammar of PacScript, in which a program is a flat list of statements.

The compiler matches the end of each block to its beginning.

The tokens come from :mod:`orinkit.virtual.rc8.pacscript.lexer`. Precedence of operators as in the RC8 manual, highest
first: ``^``, sign, ``* /``, ``\``, ``Mod``, ``+ -``, ``&``, ``<< >>``, comparison, ``Not``, ``And``, ``Or``, ``Xor``.
"""

from __future__ import annotations

from typing import Final

GRAMMAR: Final = r"""
start: _entry*
_entry: _separator | label | _statement _separator
_separator: _COLON | _LINE
label: LABEL

_statement: sub | function | marker | declare | constants | if_line | block | _simple
_simple: assign | call | jump | leave | motion | command | takearm | point | letpart | letjoint

sub: SUB NAME parameters?
function: FUNCTION NAME parameters? [AS NAME]
parameters: _OPEN [parameter (_COMMA parameter)*] _CLOSE
parameter: [BYVAL | BYREF] NAME [AS NAME]

declare: (DIM | PUBLIC) declared (_COMMA declared)*
declared: NAME [sizes] [AS NAME] [EQUAL value]
sizes: _OPEN value (_COMMA value)* _CLOSE
constants: CONST constant (_COMMA constant)*
constant: NAME [AS NAME] EQUAL value

marker: END_SUB | END_FUNCTION | END_IF | END_SELECT | ELSE | CASE_ELSE | WEND | RETURN | END

block: IF value THEN                                       -> if_
     | ELSEIF value THEN                                   -> else_if
     | FOR target EQUAL value TO value [STEP value]      -> for_
     | NEXT [target]                                        -> next_
     | DO [test]                                            -> do
     | LOOP [test]                                          -> loop
     | WHILE value                                         -> while_
     | SELECT_CASE value                                   -> select
     | CASE case_item (_COMMA case_item)*                   -> case
test: (WHILE | UNTIL) value
case_item: value                                           -> case_value
         | value TO value                                 -> case_range
         | IS relation value                               -> case_relation
!relation: EQUAL | UNLIKE | LESS | MORE | AT_MOST | AT_LEAST

if_line: IF value THEN inline [ELSE inline]
inline: _inlined (_COLON _inlined)*
_inlined: _simple | lone
lone: RETURN | END

assign: [LET] target EQUAL value
call: [CALL] target                                         -> call
    | target _COMMA values                                  -> call_more
    | target values                                         -> call_values
jump: GOTO NAME | GOSUB NAME
leave: LEAVE

motion: MOTION item (_COMMA item)*
item: [mark] value [extra]                                 -> item
    | NEXT                                                  -> item_next
mark: _AT NUMBER | _AT NAME | _AT group
extra: EXTRA _OPEN values _CLOSE
command: COMMAND [values]
takearm: TAKEARM [value] [keep]
keep: _COMMA? KEEP EQUAL value
point: POINT target
letpart: LETPART target EQUAL value
letjoint: LETJOINT value _COMMA target EQUAL value

target: NAME                                                -> name
      | NAME _OPEN [values] _CLOSE                          -> apply
      | NAME _OPEN_INDEX value _CLOSE_INDEX                -> index
values: value (_COMMA value)*

?value: xor
?xor: or_ | xor XOR or_                                     -> binary
?or_: and_ | or_ OR and_                                    -> binary
?and_: not_ | and_ AND not_                                 -> binary
?not_: compared | NOT not_                                  -> unary
?compared: shifted | compared (EQUAL | UNLIKE | LESS | MORE | AT_MOST | AT_LEAST) shifted   -> binary
?shifted: joined | shifted (LEFTWARDS | RIGHTWARDS) joined  -> binary
?joined: sum | joined AMPERSAND sum                         -> binary
?sum: rest | sum (PLUS | MINUS) rest                        -> binary
?rest: whole | rest MOD whole                               -> binary
?whole: product | whole BACKSLASH product                   -> binary
?product: signed | product (STAR | SLASH) signed            -> binary
?signed: power | (PLUS | MINUS) signed                      -> unary
?power: atom | power CARET raised                           -> binary
?raised: atom | (PLUS | MINUS) raised                       -> unary
?atom: number | text | target | group
group: _OPEN value _CLOSE                                  -> group
     | _OPEN value (_COMMA value)+ _CLOSE                 -> listed
number: NUMBER
text: STRING

%declare SUB FUNCTION END_SUB END_FUNCTION BYVAL BYREF AS DIM PUBLIC CONST IF THEN ELSE ELSEIF END_IF FOR TO STEP NEXT DO LOOP
%declare WHILE UNTIL WEND SELECT_CASE CASE CASE_ELSE END_SELECT IS GOTO GOSUB RETURN END LEAVE CALL LET MOTION COMMAND
%declare TAKEARM KEEP POINT LETPART LETJOINT EXTRA LABEL NAME NUMBER STRING AND OR XOR NOT MOD PLUS MINUS STAR SLASH
%declare BACKSLASH CARET AMPERSAND EQUAL LESS MORE AT_MOST AT_LEAST UNLIKE LEFTWARDS RIGHTWARDS SELECT
%declare _OPEN _CLOSE _COMMA _AT _OPEN_INDEX _CLOSE_INDEX _COLON _LINE
"""
"""The grammar, in the notation of lark."""
