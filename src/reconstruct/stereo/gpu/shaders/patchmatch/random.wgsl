// Random numbers.

fn hash(value: u32) -> u32 {
    let state = value * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

struct Dice {
    key: u32,
    count: u32,
}

fn unit(dice: ptr<function, Dice>) -> f32 {
    (*dice).count += 0x9E3779B9u;
    return f32(hash((*dice).key ^ (*dice).count) >> 8u) * (1.0 / 16777216.0);
}

fn signed(dice: ptr<function, Dice>) -> f32 {
    return 2.0 * unit(dice) - 1.0;
}
