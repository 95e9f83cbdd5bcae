classdef suj_arm_local < handle
    % A setup arm seen from the cart.

    properties (Access = private)
        bridge
        cart
        name
    end

    methods

        function self = suj_arm_local(bridge, cart, name)
            % Made by trocar.suj_arm.
            self.bridge = bridge;
            self.cart = cart;
            self.name = name;
        end

        function [pose, timestamp] = measured_cp(self)
            % Pose (4x4) of the carried arm's base.
            [pose, timestamp] = self.bridge.pose([self.cart '/' self.name '/local/measured_cp']);
        end

        function servo_cp(self, pose)
            % Be at this pose from now on; SUJ_Fixed only.
            self.bridge.command(self.cart, 'local/servo_cp', trocar.internal.numbers_of(pose), self.name);
        end

    end

end
