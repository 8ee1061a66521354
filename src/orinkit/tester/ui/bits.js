// The bits of a word, as switches or as lamps with text.
export default {
  template: `
    <ul class="ok-bits" :aria-label="label">
      <li v-for="bit in bits" :key="bit.number">
        <button v-if="switches" type="button" role="switch" class="ok-bit ok-bit-switch" :aria-checked="String(on(bit))"
                :aria-disabled="String(!enabled || bit.fixed)" :data-testid="marker + '-' + bit.number" :title="bit.note"
                @click="toggle(bit)">
          <span class="ok-bit-number" aria-hidden="true">{{ bit.number }}</span>
          <span class="ok-bit-title">{{ bit.title }}</span>
          <span class="ok-bit-track" aria-hidden="true"></span>
        </button>
        <div v-else class="ok-bit" role="img" :aria-label="bit.title + ': ' + state(bit)" :data-testid="marker + '-' + bit.number"
             :data-on="value === null ? '' : Number(on(bit))">
          <span :class="['ok-led', on(bit) && 'ok-led-' + (bit.tone || tone), value === null && 'ok-led-unknown']"></span>
          <span class="ok-bit-number">{{ bit.number }}</span>
          <span class="ok-bit-title">{{ bit.title }}</span>
        </div>
      </li>
    </ul>`,
  props: { bits: Array, value: Number, enabled: Boolean, switches: Boolean, label: String, marker: String, tone: String, texts: Object },
  emits: ["toggle"],
  methods: {
    on(bit) {
      return this.value !== null && ((this.value >>> bit.number) & 1) === 1;
    },
    state(bit) {
      return this.value === null ? this.texts.unknown : this.on(bit) ? this.texts.on : this.texts.off;
    },
    toggle(bit) {
      if (this.enabled && !bit.fixed) this.$emit("toggle", { number: bit.number, on: !this.on(bit) });
    },
  },
};
