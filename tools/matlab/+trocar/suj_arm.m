classdef suj_arm < trocar.measured
    % One setup arm; its poses are those of the base of the arm that it carries.

    properties (SetAccess = protected)
        name
        local  % the same seen from the cart
        primary_voltage
        secondary_voltage
    end

    properties (Access = private)
        cart
    end

    methods

        function self = suj_arm(bridge, cart, name)
            % Made by trocar.suj.
            path = [cart '/' name '/'];
            self@trocar.measured(bridge, path);
            self.cart = cart;
            self.name = name;
            self.local = trocar.suj_arm_local(bridge, cart, name);
            self.primary_voltage = trocar.measured(bridge, [path 'primary_voltage/']);
            self.secondary_voltage = trocar.measured(bridge, [path 'secondary_voltage/']);
        end

        function [pose, timestamp] = measured_cp(self)
            % Pose (4x4) in the tip of the reference arm: the carried arm's base frame.
            [pose, timestamp] = self.joints_of.pose([self.joints_path 'measured_cp']);
        end

        function servo_jp(self, jp)
            % Be at these joints from now on; KINEMATIC ones only.
            self.joints_of.command(self.cart, 'servo_jp', jp, self.name);
        end

        function handle = move_jp(self, jp)
            % The same; it is done at once.
            handle = self.joints_of.move(self.cart, 'move_jp', jp, self.name);
        end

        function clutch(self, on)
            % Let its brakes go, as its button does, for a minute at most; false: they hold.
            self.joints_of.command(self.cart, 'clutch', trocar.internal.flag(on), self.name);
        end

    end

end
