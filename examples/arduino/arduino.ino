// An exported controller on a board: docs/export_c.md. Its double must have 64 bits: not AVR.
#include "controller.h"

static controller_Controller controller;
static int64_t us; // micros() begins anew after 71.6 minutes, this does not

void setup() {
    Serial.begin(115200);
    while (controller_self_test() != CONTROLLER_SOUND) {
        Serial.println(controller_self_test()); // what it means is in controller.h
        delay(1000);
    }
    controller_reset(&controller);
}

// The pins, the offset and the factors are those of your sensors and of your drive.
void loop() {
    controller_Reading reading = {};
    reading.stamp_ns = 1000 * controller_widened(&us, micros());
    reading.position = (analogRead(A0) - 512) * 0.003; // rad
    reading.velocity = (analogRead(A1) - 512) * 0.02; // rad/s
    controller_Output output;
    controller_update(&controller, &reading, &output);
    if (output.active) {
        analogWrite(3, (int)(128 + 1.27 * output.effort)); // N m, of 100 N m at most
    }
}
