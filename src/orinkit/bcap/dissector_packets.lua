-- Packets -------------------------------------------------------------------------------------------------------------

-- Names of the arguments of a request, or of the results of a reply.
local function argument_name(called, is_request, index)
    if is_request then
        return called and called.arguments[index] or string.format("argument %d", index)
    elseif index == 1 then
        return called and called.creates ~= "" and called.creates .. " handle" or "result"
    end
    return string.format("result %d", index)
end

-- Dissect the arguments; return the position after them and their texts.
function Packet:arguments(tree, called, is_request, count, at, last)
    local texts = {}
    for index = 1, count do
        local name = argument_name(called, is_request, index)
        local after, text = self:one_argument(tree, name, at, last, count - index + 1)
        table.insert(texts, shortened(text))
        if not after then
            return last, texts
        end
        at = after
    end
    return at, texts
end

function Packet:one_argument(tree, name, at, last, missing)
    if last - at < 10 then
        local text = "an argument requires 10 bytes or more, %d are left (%d missing according to the argument count)"
        self:wrong(tree, at, last, string.format(text, last - at, missing))
        return nil, "?"
    end
    local length, vt, count = self:u32(at), self:u16(at + 4), self:u32(at + 6)
    local fits = length >= 6 and length <= last - at - 4
    local stop = fits and at + 4 + length or last
    local item = tree:add(field.argument, self.tvb(at, stop - at))
    local size = item:add_le(field.argument_length, self.tvb(at, 4))
    if not fits then
        local text = "argument length %d does not match the %d bytes that follow"
        wrong(size, nil, string.format(text, length, last - at - 4))
    end
    local after, text, broken = self:typed(item, vt, count, at + 4, stop, 0)
    item:set_text(string.format("%s: %s (%s)", name, after and shortened(text) or "?", type_name(vt)))
    if not after then
        self:wrong(item, broken, stop, text)
    elseif after ~= stop then
        self:wrong(item, after, stop, fits and mismatch(vt, count) or "the end of this value is unknown")
    end
    return fits and stop or nil, after and text or "?"
end

local library = bit or bit32 -- which one exists depends on the version of Wireshark; the operator only in Lua 5.3 or later
local bxor = library and library.bxor or load("return function(a, b) return a ~ b end")()

local CRC = {}
for value = 0, 255 do
    local crc = value * 256
    for _ = 1, 8 do
        crc = (crc >= 0x8000 and bxor(crc * 2, 0x1021) or crc * 2) % 0x10000
    end
    CRC[value] = crc
end

local function checksum(range)
    local bytes, crc = range:bytes(), 0xFFFF
    for index = 0, bytes:len() - 1 do
        local high = math.floor(crc / 256)
        crc = bxor(crc % 256 * 256, CRC[bxor(high, bytes:get_index(index))])
    end
    return crc
end

-- The reserved area, the CRC on a serial line, and EOT.
function Packet:tail(tree, at, last, stop)
    local start = last - 2
    local has_crc = last < self.size and start >= at and start <= SERIAL_PACKET
        and self:u16(start) == checksum(self.tvb(1, start - 1))
    local area = has_crc and start or last
    if at < area then
        tree:add(field.reserved_area, self.tvb(at, area - at))
    end
    if has_crc then
        tree:add_le(field.crc, self.tvb(start, 2)):append_text(" (correct)")
    end
    if last < stop and self.tvb(last, 1):uint() == EOT then
        tree:add(field.stop, self.tvb(last, 1))
    else
        self:wrong(tree, last, stop, "the final EOT 04 is missing")
    end
    if stop < self.size then
        local text = string.format("%d bytes after the end of the packet", self.size - stop)
        self:wrong(tree, stop, self.size, text)
    end
end

-- Requests and their replies ------------------------------------------------------------------------------------------

local calls = {} -- by stream and serial: the latest call
local seen = {} -- by frame, kind and serial: the call of a packet

bcap.init = function()
    calls, seen = {}, {}
end

-- The connection of a packet, the same in both directions.
local function stream_of(pinfo)
    local source = tostring(pinfo.src) .. " " .. pinfo.src_port
    local target = tostring(pinfo.dst) .. " " .. pinfo.dst_port
    local places = source < target and source .. " " .. target or target .. " " .. source
    return pinfo.port_type .. " " .. places
end

local function from_server(pinfo)
    return pinfo.match_uint == pinfo.src_port and pinfo.src_port ~= pinfo.dst_port
end

-- Return true if a code is a function id; S_FALSE is also the id of a function, so the direction decides.
local function is_request_code(pinfo, code)
    if code < 1 or code > LAST_FUNCTION_ID then
        return false
    end
    return not (RETURN_CODES[code] and from_server(pinfo))
end

-- Return the call of a packet; its entries are frames.
local function call_of(pinfo, packet)
    local key = string.format("%d %s %d", pinfo.number, packet.is_request and ">" or "<", packet.serial)
    if pinfo.visited or seen[key] then
        return seen[key]
    end
    local stream = stream_of(pinfo)
    calls[stream] = calls[stream] or {}
    local open = calls[stream]
    local call = open[packet.serial]
    if packet.is_request then
        local first = packet.is_retry and open["first " .. packet.reserved]
        if first and first.code == packet.code then
            call = first
            table.insert(call.retries, pinfo.number)
        else
            call = { code = packet.code, first = pinfo.number, time = pinfo.rel_ts, attempts = {}, retries = {}, executing = {} }
        end
        call.attempts[packet.serial] = pinfo.number
        open[packet.serial] = call
        if not packet.is_retry then
            open["first " .. packet.serial] = call
        end
    elseif call and packet.code == EXECUTING then
        table.insert(call.executing, pinfo.number)
    elseif call then
        call.response = call.response or pinfo.number
        open[packet.serial] = nil
    end
    seen[key] = call
    return call
end

local function add_frame(tree, of, number)
    if number then
        tree:add(of, number):set_generated()
    end
end

local function add_links(tree, pinfo, packet, call)
    if packet.is_request then
        add_frame(tree, field.first_in, call.first ~= pinfo.number and call.first or nil)
        for _, number in ipairs(call.first == pinfo.number and call.retries or {}) do
            add_frame(tree, field.retry_in, number)
        end
        for _, number in ipairs(call.executing) do
            add_frame(tree, field.executing_in, number)
        end
        add_frame(tree, field.response_in, call.response)
        return
    end
    add_frame(tree, field.request_in, call.attempts[packet.serial])
    local seconds = math.max(pinfo.rel_ts - call.time, 0)
    local whole = math.floor(seconds)
    local rest = math.min(math.floor((seconds - whole) * 1e9 + 0.5), 999999999)
    tree:add(field.time, NSTime.new(whole, rest)):set_generated()
end

-- Dissectors ----------------------------------------------------------------------------------------------------------

local function add_request(tree, range, packet)
    local item = tree:add_le(field.function_id, range)
    if packet.called then
        item:append_text(" " .. packet.called.text)
    else
        item:add_proto_expert_info(note.unknown, "Unknown function; a server returns E_NOTIMPL")
    end
end

local function add_reply(tree, range, packet)
    local item = tree:add_le(field.return_code, range)
    local row = RETURN_CODES[packet.code]
    if row then
        item:add(field.text, row[2]):set_generated()
        item:append_text(" " .. row[2])
    end
    if packet.code >= 0x80000000 then
        item:add_proto_expert_info(note.failed, code_name(packet.code) .. (row and ": " .. row[2] or ""))
    end
    if packet.call then
        tree:add(field.function_id, packet.call.code):set_generated()
    end
end

local function summary(packet, texts)
    local values = table.concat(texts, ", ")
    if packet.is_request then
        local name = packet.called and packet.called.name or string.format("unknown function %d", packet.code)
        local retry = packet.is_retry and string.format("Retry of %d: ", packet.reserved) or ""
        return retry .. name .. "(" .. values .. ")"
    end
    local name = packet.called and packet.called.name .. ": " or ""
    local row = RETURN_CODES[packet.code]
    if packet.code >= 0x80000000 then
        return name .. code_name(packet.code) .. (row and ": " .. row[2] or "")
    end
    return name .. (row and row[1] or code_name(packet.code)) .. (#texts > 0 and " -> " .. values or "")
end

local function add_length(self, tree, length)
    local item = tree:add_le(field.length, self.tvb(1, 4))
    if length > LIMITS.packet then
        wrong(item, nil, string.format("%d bytes exceed the limit of %d bytes", length, LIMITS.packet))
    elseif length ~= self.size then
        wrong(item, nil, string.format("%d bytes, but %d are present", length, self.size))
    end
end

-- Return the fields of the header that the rest of the dissection requires, after they have been added to the tree.
local function header(self, pinfo, tree)
    local packet = { serial = self:u16(5), reserved = self:u16(7), code = self:u32(9), count = self:u16(13) }
    packet.is_request = is_request_code(pinfo, packet.code)
    packet.is_retry = packet.is_request and packet.reserved ~= 0 and packet.reserved ~= packet.serial
    packet.call = call_of(pinfo, packet)
    packet.called = FUNCTIONS[packet.is_request and packet.code or packet.call and packet.call.code]
    tree:add_le(field.serial, self.tvb(5, 2))
    local item = tree:add_le(field.reserved, self.tvb(7, 2))
    if packet.reserved ~= 0 then
        item:append_text(" (serial of the first attempt)")
    end
    if packet.is_retry then
        tree:add(field.retry, true):set_generated()
        item:add_proto_expert_info(note.retry, string.format("Retry of the request with serial %d", packet.reserved))
    end
    local add = packet.is_request and add_request or add_reply
    add(tree, self.tvb(9, 4), packet)
    tree:add_le(field.count, self.tvb(13, 2))
    return packet
end

-- Return the end of the packet from its length, or the end of all bytes if no EOT is at that end.
local function end_of(self, length)
    local fits = length >= OVERHEAD and length <= self.size and self.tvb(length - 1, 1):uint() == EOT
    return fits and length or self.size
end

-- Dissect one packet, possibly malformed or cut off by the capture; return its text for the info column.
local function dissect(tvb, pinfo, root, cut)
    local self = setmetatable({ tvb = tvb, size = tvb:len(), left = LIMITS.variants }, Packet)
    if self.size == 0 then
        return ""
    end
    local tree = root:add(bcap, tvb(0, self.size))
    if cut then
        tree:add_proto_expert_info(note.cut)
    end
    if tvb(0, 1):uint() ~= SOH then
        wrong(tree, tvb(0, self.size), "a packet must begin with SOH 01")
        return "not a packet"
    end
    tree:add(field.start, tvb(0, 1))
    if self.size < HEADER then
        self:wrong(tree, 1, self.size, string.format("the header of %d bytes is incomplete", HEADER))
        return "incomplete packet"
    end
    local length = self:u32(1)
    local stop = end_of(self, length)
    add_length(self, tree, length)
    local packet = header(self, pinfo, tree)
    local closed = stop > HEADER and tvb(stop - 1, 1):uint() == EOT
    local last = (closed or (length == stop and stop > HEADER)) and stop - 1 or stop
    local after, texts = self:arguments(tree, packet.called, packet.is_request, packet.count, HEADER, last)
    self:tail(tree, after, last, stop)
    if packet.call then
        add_links(tree, pinfo, packet, packet.call)
    end
    local text = summary(packet, texts)
    tree:append_text(string.format(", %s %d, %s", packet.is_request and "request" or "reply", packet.serial, text))
    return text
end

local shown_frame = "" -- the frame to whose info column the latest text was added

local function show(pinfo, text)
    pinfo.cols.protocol = "b-CAP"
    local frame = pinfo.number .. tostring(pinfo.visited)
    if shown_frame == frame then
        pinfo.cols.info:append("; " .. text)
    else
        pinfo.cols.info:set(text)
    end
    shown_frame = frame
    pinfo.cols.info:fence()
end

local function packet_length(tvb, _, offset)
    local length = tvb(offset + 1, 4):le_uint()
    local fits = tvb(offset, 1):uint() == SOH and length >= OVERHEAD and length <= LIMITS.packet
    return fits and length or tvb:len() - offset -- the rest is malformed
end

local function one_of_stream(tvb, pinfo, root)
    show(pinfo, dissect(tvb, pinfo, root))
    return tvb:len()
end

-- A segment that the capture has cut off cannot be reassembled.
local function dissect_cut(tvb, pinfo, root)
    local at, size = 0, tvb:len()
    while size - at >= 5 and packet_length(tvb, pinfo, at) <= size - at do
        local length = packet_length(tvb, pinfo, at)
        show(pinfo, dissect(tvb(at, length):tvb(), pinfo, root))
        at = at + length
    end
    if at < size then
        show(pinfo, dissect(tvb(at):tvb(), pinfo, root, true))
    end
end

function bcap.dissector(tvb, pinfo, root)
    if tvb:len() < tvb:reported_len() then
        dissect_cut(tvb, pinfo, root)
    elseif pinfo.port_type == 2 then -- TCP
        dissect_tcp_pdus(tvb, root, 5, packet_length, one_of_stream)
    else
        show(pinfo, dissect(tvb, pinfo, root))
    end
    return tvb:len()
end

local function plausible(tvb)
    if tvb:len() < HEADER or tvb(0, 1):uint() ~= SOH then
        return false
    end
    local length, code, count = tvb(1, 4):le_uint(), tvb(9, 4):le_uint(), tvb(13, 2):le_uint()
    if length < OVERHEAD + 10 * count or length > LIMITS.packet or not (FUNCTIONS[code] or RETURN_CODES[code]) then
        return false
    end
    return tvb:len() < length or tvb(length - 1, 1):uint() == EOT
end

bcap:register_heuristic("udp", function(tvb, pinfo, root)
    if not plausible(tvb) or tvb(1, 4):le_uint() ~= tvb:reported_len() then
        return false
    end
    bcap.dissector(tvb, pinfo, root)
    return true
end)

bcap:register_heuristic("tcp", function(tvb, pinfo, root)
    if not plausible(tvb) then
        return false
    end
    pinfo.conversation = bcap
    bcap.dissector(tvb, pinfo, root)
    return true
end)

local tables = { DissectorTable.get("tcp.port"), DissectorTable.get("udp.port") }
local ports = ""

local function use_ports()
    if bcap.prefs.ports == ports then
        return
    end
    for _, each in ipairs(tables) do
        if ports ~= "" then
            each:remove(ports, bcap)
        end
        if bcap.prefs.ports ~= "" then
            each:add(bcap.prefs.ports, bcap)
        end
    end
    ports = bcap.prefs.ports
end

bcap.prefs_changed = use_ports
use_ports()
for _, each in ipairs(tables) do
    each:add_for_decode_as(bcap)
end
