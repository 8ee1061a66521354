// A button with two states. It changes when it is clicked; the Tester is informed afterwards.
export default {
  template: `
    <q-btn flat dense round :icon="icons[on ? 1 : 0]" :aria-label="labels[on ? 1 : 0]" @click="toggle" />`,
  props: { value: Boolean, icons: Array, labels: Array },
  emits: ["change"],
  data() {
    return { on: this.value };
  },
  watch: {
    value(value) {
      this.on = value;
    },
  },
  methods: {
    toggle() {
      this.on = !this.on;
      this.$emit("change", this.on);
    },
  },
};
