// A scrolling list of packets of which only the visible rows exist. The server supplies the rows of a window.
const ROW = 26; // px, as in tester.css
const SPARE = 10; // rows above and below the visible ones, to scroll to

// Give each row the key of its element. A new row gets the element of a row that is gone: changing the text of an element
// takes less time than creating one.
function withKeys(rows, before) {
  const kept = new Map(before.map(({ key, row }) => [row[0], key]));
  const keys = rows.map((row) => {
    const key = kept.get(row[0]);
    kept.delete(row[0]);
    return key;
  });
  const free = [...kept.values()];
  let next = Math.max(-1, ...before.map(({ key }) => key)) + 1;
  return rows.map((row, index) => ({ key: keys[index] ?? free.shift() ?? next++, row }));
}

export default {
  template: `
    <div class="ok-packets" role="grid" tabindex="0" :data-testid="labels.marker + '-list'" :aria-label="labels.list"
         :aria-rowcount="count + 1" :aria-activedescendant="active" @keydown="pressed">
      <div class="ok-packet ok-packets-head" role="row" aria-rowindex="1">
        <span v-for="each in labels.columns" role="columnheader">{{ each }}</span>
      </div>
      <div ref="scroller" class="ok-packets-scroll" @scroll.passive="scrolled" @wheel.passive="touched"
           @pointerdown="touched" @touchmove.passive="touched">
        <div class="ok-packets-space" :style="{height: count * 26 + 'px'}">
          <div class="ok-packets-window" :style="{top: (state.start - state.first) * 26 + 'px'}">
            <div v-for="({key, row}, index) in shown" :key="key" role="row" :id="'ok-packet-' + row[0]"
                 :class="['ok-packet', row[6] && 'ok-' + row[6], row[0] === state.selected && 'ok-selected']"
                 :aria-selected="row[0] === state.selected" :aria-rowindex="state.start - state.first + index + 2"
                 :data-number="row[0]" @click="$emit('pick', row[0])">
              <span role="gridcell">{{ row[0] }}</span>
              <span role="gridcell">{{ row[1] }}</span>
              <span role="gridcell">{{ row[2] }}</span>
              <span role="gridcell" :class="row[3] === '>' ? 'ok-sent' : 'ok-received'"
                    :aria-label="row[3] === '>' ? labels.sent : labels.received">{{ row[3] === '>' ? '→' : '←' }}</span>
              <span role="gridcell">{{ row[4] }}</span>
              <span role="gridcell"><b v-for="mark in row[7]" class="ok-mark">{{ mark }}</b>{{ row[5] }}</span>
            </div>
          </div>
        </div>
        <div v-if="!count" class="ok-empty">{{ labels.empty }}</div>
      </div>
    </div>`,
  props: { state: Object, labels: Object },
  emits: ["window", "pick", "move", "follow"],
  computed: {
    shown() {
      this.previous = withKeys(this.state.rows, this.previous);
      return this.previous;
    },
    count() {
      return this.state.end - this.state.first;
    },
    active() {
      return this.state.rows.some((row) => row[0] === this.state.selected) ? "ok-packet-" + this.state.selected : null;
    },
  },
  watch: {
    state(now, before) {
      this.$nextTick(() => this.place(now, before));
    },
  },
  created() {
    this.previous = [];
  },
  mounted() {
    this.resizing = new ResizeObserver(() => {
      if (this.state.follow) this.toEnd();
      this.request();
    });
    this.resizing.observe(this.$refs.scroller);
    if (this.state.follow) this.toEnd();
  },
  unmounted() {
    this.resizing.disconnect();
    clearTimeout(this.timer);
  },
  methods: {
    place(now, before) {
      const scroller = this.$refs.scroller;
      if (!scroller) return;
      if (now.follow) {
        this.toEnd();
      } else if (now.view === before.view && now.first !== before.first) {
        scroller.scrollTop -= (now.first - before.first) * ROW; // the same packets stay visible
      }
      if (now.reveal !== before.reveal && now.position >= 0) this.reveal((now.position - now.first) * ROW);
      this.request();
    },
    reveal(top) {
      const scroller = this.$refs.scroller;
      const shown = scroller.clientHeight;
      if (top < scroller.scrollTop || top + ROW > scroller.scrollTop + shown) {
        const near = Math.abs(top - scroller.scrollTop) < 2 * shown;
        scroller.scrollTop = near ? (top < scroller.scrollTop ? top : top + ROW - shown) : top - shown / 2;
      }
    },
    toEnd() {
      if (performance.now() < this.heldUntil) return; // the user is scrolling
      const scroller = this.$refs.scroller;
      scroller.scrollTop = this.latest = scroller.scrollHeight;
      this.latest = scroller.scrollTop;
    },
    touched(event) {
      this.input = performance.now();
      if (!this.state.follow || event.deltaY > 0) return;
      this.heldUntil = this.input + 400;
      if (event.deltaY < 0 && this.$refs.scroller.scrollTop > 0) this.$emit("follow", false);
    },
    scrolled() {
      const scroller = this.$refs.scroller;
      const top = scroller.scrollTop;
      const atEnd = scroller.scrollHeight - top - scroller.clientHeight < ROW;
      if (this.state.follow && !atEnd && top < this.latest) this.$emit("follow", false);
      if (!this.state.follow && atEnd && performance.now() - (this.input || -1e9) < 600) this.$emit("follow", true);
      this.latest = top;
      if (!this.timer) this.timer = setTimeout(() => this.request(), 25);
    },
    request() {
      clearTimeout(this.timer);
      this.timer = null;
      const scroller = this.$refs.scroller;
      if (!scroller) return;
      const scrolling = performance.now() < this.heldUntil;
      const spare = this.state.follow && !scrolling ? 1 : SPARE;
      const index = Math.max(Math.floor(scroller.scrollTop / ROW) - spare, 0);
      const size = Math.min(Math.ceil(scroller.clientHeight / ROW) + 2 * spare, 200);
      const start = this.state.first + index;
      const key = this.state.follow ? `follow ${size}` : `${this.state.view} ${start} ${size}`;
      if (key === this.requested) return;
      this.requested = key;
      this.$emit("window", { start, size });
    },
    pressed(event) {
      const page = Math.max(Math.floor(this.$refs.scroller.clientHeight / ROW) - 1, 1);
      const steps = { ArrowUp: -1, ArrowDown: 1, PageUp: -page, PageDown: page, Home: "first", End: "last" };
      if (!(event.key in steps) || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      this.$emit("move", steps[event.key]);
    },
  },
};
