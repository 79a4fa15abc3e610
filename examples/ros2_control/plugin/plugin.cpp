// A chainable effort controller around an exported PID: docs/export_c.md. Another law has other gains, and
// computed_torque and state_feedback also read reading.hip.
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "controller.h"
#include "controller_interface/chainable_controller_interface.hpp"
#include "pluginlib/class_list_macros.hpp"

namespace exported_controller {

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;
constexpr auto INDIVIDUAL = controller_interface::interface_configuration_type::INDIVIDUAL;
constexpr double NONE = std::numeric_limits<double>::quiet_NaN();

class Controller : public controller_interface::ChainableControllerInterface {
  public:
    CallbackReturn on_init() override {
        controller_reset(&controller_);
        controller_Parameters exported;
        controller_parameters(&controller_, &exported);
        joint_ = auto_declare<std::string>("joint", "trunk");
        auto_declare<double>("gains.p", exported.gains_p);
        auto_declare<double>("gains.i", exported.gains_i);
        auto_declare<double>("gains.d", exported.gains_d);
        return controller_self_test() == CONTROLLER_SOUND ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
    }

    InterfaceConfiguration command_interface_configuration() const override {
        return {INDIVIDUAL, {joint_ + "/effort"}};
    }

    InterfaceConfiguration state_interface_configuration() const override {
        return {INDIVIDUAL, {joint_ + "/position", joint_ + "/velocity"}};
    }

    CallbackReturn on_configure(const rclcpp_lifecycle::State &) override {
        joint_ = get_node()->get_parameter("joint").as_string();
        controller_reset(&controller_);
        controller_Parameters gains;
        gains.gains_p = get_node()->get_parameter("gains.p").as_double();
        gains.gains_i = get_node()->get_parameter("gains.i").as_double();
        gains.gains_d = get_node()->get_parameter("gains.d").as_double();
        reference_interfaces_.assign(1, NONE);
        return controller_retune(&controller_, &gains) ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
    }

    // From the torque that acts, if the plant was seen before.
    CallbackReturn on_activate(const rclcpp_lifecycle::State &) override {
        reference_interfaces_.assign(1, NONE);
        controller_activate(&controller_);
        return CallbackReturn::SUCCESS;
    }

    CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override {
        controller_deactivate(&controller_);
        return CallbackReturn::SUCCESS;
    }

    return_type update_and_write_commands(const rclcpp::Time & time, const rclcpp::Duration &) override {
        controller_Reading reading{};
        reading.stamp_ns = time.nanoseconds();
        reading.position = state_interfaces_[0].get_value();
        reading.velocity = state_interfaces_[1].get_value();
        reading.effort = effort_;
        reading.has_reference = std::isfinite(reference_interfaces_[0]);
        reading.reference = reading.has_reference ? reference_interfaces_[0] : 0.0;
        controller_Output output{};
        controller_update(&controller_, &reading, &output);
        if (output.active) {
            effort_ = output.effort;
            (void)command_interfaces_[0].set_value(effort_);
        }
        return return_type::OK;
    }

  protected:
    std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() override {
        std::vector<hardware_interface::CommandInterface> interfaces;
        reference_interfaces_.assign(1, NONE);
        interfaces.emplace_back(get_node()->get_name(), joint_ + "/position", &reference_interfaces_[0]);
        return interfaces;
    }

    bool on_set_chained_mode(bool) override {
        return true;
    }

    return_type update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &) override {
        return return_type::OK; // without a chain the reference is that of the parameters
    }

  private:
    std::string joint_;
    controller_Controller controller_;
    double effort_ = 0.0; // N m, the last command
};

} // namespace exported_controller

PLUGINLIB_EXPORT_CLASS(exported_controller::Controller, controller_interface::ChainableControllerInterface)
