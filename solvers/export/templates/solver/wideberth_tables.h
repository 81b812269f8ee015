/* Made by wideberth; wideberth_solver.c alone includes it. */
wideberth_kernel {{ kernels|join(", ") }};

{% for name, value in constants.items() %}
#define WIDEBERTH_{{ name }} {{ value }}
{% endfor %}

{% for array in fixed %}
{{ array }}
{% endfor %}
static const double LIMITS[2][{{ limits[0]|length }}] = {
{% for row in limits %}
    { {%- for value in row %}{{ value|number }}{{ ", " if not loop.last }}{% endfor -%} },
{% endfor %}
};
{% for array in kinds %}
{{ array }}
{% endfor %}
static const struct kind KINDS[WIDEBERTH_KINDS] = {
{% for one in own %}
    { {{- one -}} },
{% endfor %}
};

struct work {
    int64_t table[{{ words }}];
    int64_t kernels[WIDEBERTH_PLAIN_KERNELS], slot_kernels[WIDEBERTH_SLOT_KERNELS];
    double settings[{{ settings }}], numbers[{{ numbers }}];
    double nothing[2];
    double states[WIDEBERTH_HORIZON + 1][WIDEBERTH_STATES];
};

typedef char wideberth_work_fits[sizeof(struct work) <= WIDEBERTH_WORK ? 1 : -1];

#define WIDEBERTH_ROWS \
{% for row in rows %}
    ROW({{ row|join(", ") }});{{ " \\" if not loop.last }}
{% endfor %}
