// The bytes of a packet and its fields. Pointing at a field, or focusing it, marks its bytes, and the other way round.
const PER_ROW = 16;

function element(name, classes, text) {
  const made = document.createElement(name);
  if (classes) made.className = classes;
  if (text !== undefined) made.textContent = text;
  return made;
}

function showWithin(box, inner) {
  const outer = box.getBoundingClientRect();
  const at = inner.getBoundingClientRect();
  if (at.top < outer.top) box.scrollTop -= outer.top - at.top;
  else if (at.bottom > outer.bottom) box.scrollTop += at.bottom - outer.bottom;
}

export default {
  template: `
    <div class="ok-packet-detail">
      <div>
        <div ref="dump" class="ok-dump" role="group" tabindex="0" :aria-label="labels.bytes" @keydown="pressedInDump"
             @focus="focusDump" @mouseover="overByte" @mouseleave="mark(pinned)" @click="clickByte"></div>
        <div ref="status" class="ok-dump-status" role="status"></div>
      </div>
      <ul ref="fields" class="ok-fields" :aria-label="labels.fields" @keydown="pressedInFields" @mouseover="overField"
          @mouseleave="mark(pinned)" @focusin="focusField" @click="overField($event, true)"></ul>
    </div>`,
  props: { packet: Object, labels: Object },
  watch: {
    packet() {
      this.build();
    },
  },
  created() {
    Object.assign(this, { pinned: -1, cursor: -1, marked: -1, bytes: [], signs: [], rows: [], fieldOf: [] });
  },
  mounted() {
    this.build();
  },
  methods: {
    build() {
      const { hex, fields } = this.packet;
      this.pinned = this.cursor = this.marked = -1;
      this.bytes = [];
      this.signs = [];
      this.fieldOf = new Array(hex.length / 2).fill(-1);
      fields.forEach(([offset, length], index) => this.fieldOf.fill(index, offset, Math.min(offset + length, this.fieldOf.length)));
      const dump = document.createDocumentFragment();
      for (let at = 0; at < hex.length / 2; at += PER_ROW) dump.append(this.dumpRow(hex, at));
      this.$refs.dump.replaceChildren(dump);
      this.rows = fields.map((field, index) => this.fieldRow(field, index));
      this.$refs.fields.replaceChildren(...this.rows);
      this.$refs.dump.scrollTop = this.$refs.fields.scrollTop = 0;
      this.$refs.status.textContent = this.packet.note;
    },
    dumpRow(hex, start) {
      const row = element("div", "ok-dump-row");
      row.append(element("span", "ok-dump-offset", start.toString(16).padStart(4, "0")));
      const text = element("span", "ok-dump-text");
      for (let at = start; at < start + PER_ROW; at++) {
        const byte = hex.slice(2 * at, 2 * at + 2);
        const cell = element("span", at % 8 === 0 && at % 16 ? "ok-byte ok-byte-gap" : "ok-byte", byte || "  ");
        row.append(cell);
        if (!byte) continue;
        const value = parseInt(byte, 16);
        const sign = element("span", "", value > 31 && value < 127 ? String.fromCharCode(value) : "·");
        cell.dataset.byte = sign.dataset.byte = at;
        if (this.fieldOf[at] >= 0 && this.packet.fields[this.fieldOf[at]][4]) cell.classList.add("ok-wrong");
        this.bytes.push(cell);
        this.signs.push(sign);
        text.append(sign);
      }
      row.append(text);
      return row;
    },
    fieldRow([offset, length, name, meaning, error, level], index) {
      const row = element("li", error ? "ok-field ok-wrong" : "ok-field");
      row.dataset.field = index;
      row.tabIndex = index ? -1 : 0;
      row.append(element("span", "ok-field-offset", offset));
      const title = element("span", "ok-field-name", name);
      title.style.paddingLeft = `${12 * level}px`;
      row.append(title, element("span", "ok-field-meaning", meaning));
      return row;
    },
    mark(index, { scrollBytes = false, scrollField = false } = {}) {
      if (index !== this.marked) {
        this.paint(this.marked, false);
        this.paint(index, true);
        this.marked = index;
      }
      if (index < 0) return;
      const first = this.bytes[this.packet.fields[index][0]];
      if (scrollBytes && first) showWithin(this.$refs.dump, first);
      if (scrollField) showWithin(this.$refs.fields, this.rows[index]);
    },
    paint(index, on) {
      const field = this.packet.fields[index];
      if (!field) {
        if (on) this.$refs.status.textContent = this.packet.note;
        return;
      }
      const end = Math.min(field[0] + field[1], this.bytes.length);
      for (let at = field[0]; at < end; at++) {
        this.bytes[at].classList.toggle("ok-on", on);
        this.signs[at].classList.toggle("ok-on", on);
      }
      this.rows[index].classList.toggle("ok-on", on);
      if (!on) return;
      const place = field[1] > 1 ? `${field[0]}–${field[0] + field[1] - 1}` : field[0];
      this.$refs.status.textContent = `${place}  ${field[2]}${field[3] ? ": " + field[3] : ""}`;
    },
    overByte(event) {
      const at = event.target.dataset.byte;
      if (at !== undefined) this.mark(this.fieldOf[at], { scrollField: true });
    },
    focusDump() {
      if (this.$refs.dump.matches(":focus-visible")) this.move(Math.max(this.cursor, 0));
    },
    clickByte(event) {
      const at = event.target.dataset.byte;
      if (at !== undefined) this.move(Number(at));
    },
    move(at) {
      if (!this.bytes.length) return;
      if (this.cursor >= 0) this.bytes[this.cursor].classList.remove("ok-cursor");
      this.cursor = Math.max(0, Math.min(at, this.bytes.length - 1));
      this.bytes[this.cursor].classList.add("ok-cursor");
      showWithin(this.$refs.dump, this.bytes[this.cursor]);
      this.pinned = this.fieldOf[this.cursor];
      this.mark(this.pinned, { scrollField: true });
    },
    pressedInDump(event) {
      const steps = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -PER_ROW, ArrowDown: PER_ROW, Home: -1e6, End: 1e6 };
      if (!(event.key in steps)) return;
      event.preventDefault();
      this.move(this.cursor + steps[event.key]);
    },
    overField(event, pin) {
      const row = event.target.closest("[data-field]");
      if (!row) return;
      if (pin) this.pinned = Number(row.dataset.field);
      this.mark(Number(row.dataset.field), { scrollBytes: true });
    },
    focusField(event) {
      this.overField(event, true);
    },
    pressedInFields(event) {
      const steps = { ArrowUp: -1, ArrowDown: 1, Home: -1e6, End: 1e6 };
      const row = event.target.closest("[data-field]");
      if (!row || !(event.key in steps)) return;
      event.preventDefault();
      const index = Number(row.dataset.field) + steps[event.key];
      const next = this.rows[Math.max(0, Math.min(index, this.rows.length - 1))];
      row.tabIndex = -1;
      next.tabIndex = 0;
      next.focus();
    },
  },
};
