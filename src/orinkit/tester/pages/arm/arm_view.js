// The canvas of the 3D view, and its pointer. A worker draws (drawing/index.js); this page only passes calls on to it.
const TURN = 0.0015; // parts of the height for one step of a mouse wheel

export default {
  template: `<div><canvas ref="canvas"></canvas></div>`,
  props: { dark: Boolean },
  mounted() {
    this.pointers = new Map();
    this.waiting = [];
    this.canvas = this.$refs.canvas;
    this.begin();
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(this.$el);
    this.listen();
    this.$emit("init");
  },
  unmounted() {
    this.observer?.disconnect();
    this.send(["close"]);
    setTimeout(() => this.worker?.terminate(), 1000);
  },
  methods: {
    begin() {
      const canvas = this.canvas;
      if (!canvas.transferControlToOffscreen || !window.Worker) return this.drawHere();
      this.worker = new Worker(import.meta.resolve("orinkit-arm"), { type: "module" });
      this.worker.onmessage = ({ data }) => this.report(data);
      this.worker.onerror = () => this.report({ failed: true });
      const offscreen = canvas.transferControlToOffscreen();
      this.worker.postMessage({ canvas: offscreen, three: import.meta.resolve("nicegui-scene"), dark: this.dark }, [offscreen]);
      this.send = (call) => this.worker.postMessage(call);
    },
    // Draw in the page, because the browser cannot draw in a worker.
    async drawHere() {
      this.send = (call) => this.waiting.push(call);
      try {
        const [{ Drawing }, { THREE }] = await Promise.all([import("orinkit-arm"), import("nicegui-scene")]);
        const drawing = new Drawing(THREE, this.canvas, this.dark, (state) => this.report(state));
        this.send = ([name, ...values]) => drawing[name](...values);
        this.resize();
        this.waiting.splice(0).forEach(this.send);
      } catch (error) {
        console.error(error);
        this.send = () => {};
        this.$emit("failed");
      }
    },
    report(state) {
      if (state.failed && this.worker) {
        this.worker.terminate();
        this.worker = null;
        const canvas = document.createElement("canvas");
        this.canvas.replaceWith(canvas); // the worker has the previous one
        this.canvas = canvas;
        this.drawHere().then(() => this.$emit("init"));
      }
      if (state.ready) this.$el.dataset.ready = "1";
      if ("simple" in state) {
        this.simple = state.simple;
        this.$el.dataset.simple = state.simple ? "1" : "0";
        this.$emit("simple", state.simple);
      }
    },
    resize() {
      this.send(["size", this.$el.clientWidth, this.$el.clientHeight, window.devicePixelRatio]);
    },
    call(name, ...values) {
      this.send([name, ...values]);
    },
    toggle() {
      this.send(["simplify", !this.simple]);
    },
    // One pointer turns the view, or moves it with the right button or Shift. Two fingers move it and change its size.
    listen() {
      const el = this.$el, pointers = this.pointers;
      const spread = ([a, b]) => Math.hypot(a.x - b.x, a.y - b.y);
      const middle = (all) => ({ x: all.reduce((sum, p) => sum + p.x, 0) / all.length, y: all.reduce((sum, p) => sum + p.y, 0) / all.length });
      el.addEventListener("contextmenu", (event) => event.preventDefault());
      el.addEventListener("pointerdown", (event) => {
        el.setPointerCapture(event.pointerId);
        pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      });
      el.addEventListener("pointermove", (event) => {
        if (!pointers.has(event.pointerId)) return;
        const before = [...pointers.values()];
        pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
        const now = [...pointers.values()], height = el.clientHeight || 1;
        const x = (middle(now).x - middle(before).x) / height, y = (middle(now).y - middle(before).y) / height;
        const shift = event.shiftKey || event.ctrlKey || event.metaKey || event.buttons & 6;
        this.send([now.length > 1 || shift ? "pan" : "orbit", x, y]);
        if (now.length === 2) this.send(["zoom", spread(before) / Math.max(spread(now), 1)]);
      });
      for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
        el.addEventListener(name, (event) => pointers.delete(event.pointerId));
      }
      el.addEventListener("wheel", (event) => {
        event.preventDefault();
        this.send(["zoom", Math.exp(event.deltaY * (event.deltaMode ? 30 : 1) * TURN)]);
      }, { passive: false });
    },
  },
};
